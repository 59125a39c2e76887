"""The profiles that are drafted while a log is read, for vehicles that name none."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from mavhums.actuator.draft import Draft, drafted_airframe, is_guessed
from mavhums.actuator.telemetry import TIERS
from mavhums.core.arrays import Integers
from mavhums.engine.vehicle_setup import SetupHistory
from mavhums.log import Table
from mavhums.log.base.decoder import text_of
from mavhums.vehicle.formats import SERVO_SOURCES, reports
from mavhums.vehicle.formats.base import each
from mavhums.vehicle.parameters import control_surfaces

_SETTLED_S: Final = 5
"""A profile is drafted this long after the first telemetry: every named value that is sent once a second has
come by then."""

_NAMES_SERVO: Final = {tier.name: tier.names_servo for tier in TIERS}
_NAMING: Final = tuple(source for source in SERVO_SOURCES if _NAMES_SERVO[source.tier])


class Drafts:
    """Drafts the profiles of vehicles by their parameters, once these have come and their servos report."""

    def __init__(self) -> None:
        self._first_s: dict[int, int] = {}
        self._names: dict[int, set[str]] = {}
        self._done: set[int] = set()

    def give_up(self, vehicle: int) -> None:
        """Draft no profile for a vehicle: it has one."""
        self._done.add(vehicle)
        self._names.pop(vehicle, None)

    def feed(
        self,
        vehicle: int,
        telemetry: Sequence[Table],
        setups: SetupHistory,
        reached_s: Callable[[Integers], Integers],
    ) -> Draft | None:
        """Take a vehicle's messages of servos that they name; return its profile if it can be drafted now.

        ``reached_s`` returns the flight seconds of places in the log.
        """
        if vehicle in self._done:
            return None
        places = np.concatenate([np.stack([table.frame, table.time_us]) for table in telemetry], axis=1)
        frames, times = places[:, np.argsort(places[0], kind="stable")]
        seconds, rows = np.unique(reached_s(frames), return_index=True)
        first_s = self._first_s.setdefault(vehicle, int(seconds[0]))
        for second, row in zip(seconds.tolist(), rows.tolist(), strict=True):
            parameters = setups.settled(second).parameters if second >= first_s + _SETTLED_S else None
            if parameters is not None and control_surfaces(parameters):
                names = self._heard(vehicle, telemetry, int(frames[row]))
                self.give_up(vehicle)
                place = int(frames[row]), int(times[row])
                return Draft(vehicle, *place, drafted_airframe(parameters, names), tuple(sorted(names)))
        self._heard(vehicle, telemetry, int(frames[-1]))
        return None

    def _heard(self, vehicle: int, telemetry: Sequence[Table], until: int) -> set[str]:
        """Return the names of a vehicle's values whose meaning is guessed, up to a place in the log."""
        names = self._names.setdefault(vehicle, set())
        for report in reports({table.name: table for table in telemetry}, "script value"):
            sent = report.values[report.table.frame <= until]
            names.update(filter(is_guessed, map(text_of, np.unique(sent).tolist())))
        return names


def telemetry_of_servos(tables: Mapping[str, Table]) -> Iterator[tuple[int, list[Table]]]:
    """Yield each vehicle's messages that say of which servo they are."""
    found: dict[int, list[Table]] = {}
    for source in _NAMING:
        table = tables.get(source.message)
        if table is None:
            continue
        rows = np.ones(len(table), dtype=bool) if source.marked is None else source.marked(table)
        for report in reports({source.message: table}, "script value"):
            names, row = np.unique(report.values, return_inverse=True)
            rows |= np.array([is_guessed(text_of(name)) for name in names.tolist()])[row]
        for vehicle, own in each(table.system, rows):
            found.setdefault(vehicle, []).append(table.select(np.arange(len(table))[own]))
    yield from found.items()
