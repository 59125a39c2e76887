"""Compares each aircraft's flights with its past, and commits the verdicts.

Where all new flights come after those that have verdicts, and nothing else has changed, only they are judged.
Otherwise all flights of the aircraft are.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from mavhums.core.conditions import URGENCY
from mavhums.core.errors import MavhumsError
from mavhums.fleet.judging import count
from mavhums.flights.aircraft import UNKNOWN
from mavhums.flights.aircraft_table import Since
from mavhums.flights.checkpoint import (
    Checkpoint,
    FlightEntry,
    Superseded,
    TooLateError,
    listed,
    read_checkpoint,
    stamp_of,
    store_checkpoint,
)
from mavhums.flights.compare import compared, unpacked
from mavhums.flights.corrections import Repair, Repairs, add_repairs, remove_repairs, repairs_in, since_of
from mavhums.flights.history import PastFlight
from mavhums.flights.reports import store_standings
from mavhums.flights.store import Store
from mavhums.flights.store_tables import COPIES, VERDICTS
from mavhums.results.assessment import Assessment

if TYPE_CHECKING:
    from distributed import Client

_PART_FLIGHTS: Final = 200
_PART_BYTES: Final = 4 << 20
_AT_ONCE: Final = 2
_FLIGHTS_AT_ONCE: Final = 50_000  # about 26 kB each
_SHOWN: Final = 20  # names in a message
_LARGEST: Final = 4 << 20


class FlightSpan(NamedTuple):
    """Some consecutive flights of an aircraft, to be compared with those before.

    Attributes
    ----------
    aircraft
        Its name; flights of an unknown one are compared with no other.
    flights
        The flights judged alone, as the store keeps them, in time order.
    since
        Returns the dates from which an actuator's flights count at a time.
    checkpoint
        The packed checkpoint of the flights before; None for the first ones.
    final
        Whether the verdicts on the flights before are final.
    whole
        Whether to keep the sums of all flights, if these are the first ones.
    """

    aircraft: str
    flights: Sequence[bytes]
    since: Callable[[datetime], Since]
    checkpoint: bytes | None = None
    final: bool = False
    whole: bool = False


class PartResult(NamedTuple):
    """The result of a part.

    Attributes
    ----------
    rows
        The verdicts, as rows of the store.
    superseded, open_superseded
        Recordings that do not count, of flights to which none can be added any more, and of the others.
    checkpoint
        What the next part needs.
    """

    rows: list[dict[str, object]]
    superseded: Superseded
    open_superseded: Superseded
    checkpoint: bytes


def compare_part(part: FlightSpan) -> PartResult | None:
    """Return the verdicts of a part; None if they need more of the earlier flights than was kept."""
    if part.checkpoint is None:
        checkpoint = Checkpoint(part.since, whole=part.whole)
    else:
        checkpoint = Checkpoint.restored(part.checkpoint, part.since, final=part.final)
    rows: list[dict[str, object]] = []
    try:
        for data in part.flights:
            flight = unpacked(data)
            if part.aircraft == UNKNOWN:
                rows += rows_of(part.aircraft, flight.assessment)
                continue
            assessment = compared(flight, checkpoint.baselines, checkpoint.past)
            rows += rows_of(part.aircraft, assessment)
            if assessment.log.start_utc is not None:
                checkpoint.add(PastFlight.of(assessment))
    except TooLateError:
        return None
    return PartResult(rows, checkpoint.superseded, checkpoint.open_superseded(), checkpoint.packed())


def rows_of(aircraft: str, assessment: Assessment) -> Iterator[dict[str, object]]:
    """Yield a row of the store for each verdict."""
    log = assessment.log
    start_us = None
    if log.start_utc is not None:
        start_us = round(datetime.fromisoformat(log.start_utc).timestamp() * 1e6)
    for verdict in assessment.verdicts:
        yield {
            "aircraft": aircraft,
            "path": log.path,
            "sha256": log.sha256,
            "start_us": start_us,
            "vehicle": verdict.vehicle,
            "actuator": verdict.actuator,
            "condition": verdict.condition,
            "worst": verdict.worst,
            "urgency": float(URGENCY[verdict.gravest]),
            "friction_nm": verdict.friction_nm.estimate if verdict.friction_nm else None,
            "airframe": assessment.airframe,
            "verdict": verdict.model_dump_json(),
        }


def second_pass(store: Store, aircraft: Iterable[str], client: Client | None = None) -> None:
    """Judge the flights of some aircraft by their past, in this process or by workers, and commit.

    A flight that several logs record has the verdicts of the best one; the others are stored as its copies.
    """
    if client is None:
        for name in aircraft:
            store.retried(partial(_compare_again, store, name))
    else:
        _by_workers(store, iter(aircraft), client)


def _compare_again(store: Store, aircraft: str) -> None:
    """Judge the flights of an aircraft by its past in this process, and commit the verdicts."""
    committed = False
    while not committed:
        running_pass = _SecondPass(store, aircraft)
        while running_pass.parts():
            running_pass.take(compare_part(running_pass.following()))
        committed = running_pass.commit()


def _by_workers(store: Store, aircraft: Iterator[str], client: Client) -> None:
    from deltalake.exceptions import CommitFailedError
    from distributed import as_completed

    running: Any = as_completed()
    active: dict[str, _SecondPass] = {}

    def go_on(running_pass: _SecondPass) -> None:
        if running_pass.parts():
            future = client.submit(compare_part, running_pass.following(), pure=False)
            active[future.key] = running_pass
            running.add(future)
            return
        try:
            committed = running_pass.commit()
        except CommitFailedError:
            committed = False
        if not committed:
            second_pass(store, [running_pass.aircraft])

    def start() -> None:
        while len(active) < most and sum(each.size for each in active.values()) < _FLIGHTS_AT_ONCE:
            name = next(aircraft, None)
            if name is None:
                return
            go_on(_SecondPass(store, name))

    most = _AT_ONCE * count(client)
    start()
    for future in running:
        running_pass = active.pop(future.key)
        if future.status == "finished":
            running_pass.take(future.result())
            go_on(running_pass)
        else:  # the worker died, or the flights cannot be read: this process tells
            second_pass(store, [running_pass.aircraft])
        future.release()
        start()


class _SecondPass:
    """The second pass of one aircraft, in parts that are judged one after the other.

    Parameters
    ----------
    store
        The store.
    aircraft
        Name of the aircraft.
    """

    def __init__(self, store: Store, aircraft: str) -> None:
        self.aircraft = aircraft
        self._store = store
        self._checkpoint: bytes | None = None
        self._rows: list[dict[str, object]] = []
        self._superseded: Superseded = {}
        self._open_superseded: Superseded = {}
        self._size = 0
        self._since = since_of(store, aircraft)
        self._stamp = stamp_of(store, aircraft)
        self._listed = listed(store, aircraft)
        kept = read_checkpoint(store, aircraft, self._listed, self._stamp)
        self._final = kept is not None
        known, new = kept or (None, self._listed)
        self._begin(known, new, whole=False)

    @property
    def size(self) -> int:
        """Number of flights whose verdicts are made."""
        return self._size

    def parts(self) -> bool:
        """Return whether a part is left."""
        return bool(self._next)

    def following(self) -> FlightSpan:
        """Return the part to be judged next."""
        return FlightSpan(self.aircraft, self._next, self._since, self._checkpoint, self._final, self._whole)

    def take(self, result: PartResult | None) -> None:
        """Take the result of the part; where it needed more than was kept, begin with the first flight."""
        if result is None:
            self._final, whole = False, not self._final
            self._begin(None, self._listed, whole=whole)
            return
        self._rows += result.rows
        self._superseded |= result.superseded
        self._open_superseded = result.open_superseded
        self._checkpoint = result.checkpoint
        self._next = next(self._waiting, [])

    def commit(self) -> bool:
        """Commit the verdicts; False if another scan has added flights meanwhile."""
        counted, copies = self._divided()
        if self._final:
            self._store.add_verdicts(self.aircraft, counted, copies)
        else:
            self._store.replace(VERDICTS, self.aircraft, counted)
            self._store.replace(COPIES, self.aircraft, copies)
        if self._store.is_shared and listed(self._store, self.aircraft) != self._listed:
            return False
        store_standings(self._store, self.aircraft)
        small = self._checkpoint if self._checkpoint and len(self._checkpoint) <= _LARGEST else None
        store_checkpoint(self._store, self.aircraft, self._listed, self._stamp, small)
        return True

    def _begin(self, known: bytes | None, new: list[FlightEntry], *, whole: bool) -> None:
        self._checkpoint = known
        self._whole = whole
        self._rows = []
        self._superseded = {}
        self._open_superseded = {}
        self._size = len(new)
        self._waiting = self._flights(new)
        self._next = next(self._waiting, [])

    def _flights(self, new: list[FlightEntry]) -> Iterator[list[bytes]]:
        """Yield the flights, in time order, in parts."""
        part: list[bytes] = []
        size = 0
        for data in self._store.flights(
            self.aircraft, [each.sha256 for each in new] if self._final else None
        ):
            part.append(data)
            size += len(data)
            if len(part) == _PART_FLIGHTS or size > _PART_BYTES:
                yield part
                part, size = [], 0
        if part:
            yield part

    def _divided(self) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
        """Return the rows of the recordings that count, and one row for each log with one that does not."""
        left_out: dict[Any, str | None] = {**self._superseded, **self._open_superseded}
        counted: list[dict[str, object]] = []
        copies: dict[Any, dict[str, object]] = {}
        for row in self._rows:
            key = row["airframe"], row["sha256"], row["vehicle"]
            if key not in left_out:
                counted.append(row)
                continue
            taken = {"counted": left_out[key]}
            copies[key] = {name: row[name] for name in ("aircraft", "path", "sha256", "vehicle")} | taken
        return counted, [*copies.values()]


def change_repairs(store: str | os.PathLike[str], *, add: Repairs = (), remove: Repairs = ()) -> list[Repair]:
    """Add and remove repairs, compare the flights of their aircraft again, and return all repairs.

    Parameters
    ----------
    store
        Folder or address of the store.
    add
        Repairs to be stored; one that is there already changes nothing.
    remove
        Repairs that were entered by mistake.

    Raises
    ------
    MavhumsError
        If the store does not exist or cannot be written, another scan writes into it, or it does not have a
        repair that is to be removed, or the aircraft or actuator of one that is to be added.
    """
    kept = Store(store).opened()
    _check_aircraft_known(kept, add)
    with kept.locked():
        aircraft = remove_repairs(kept, remove)
        aircraft |= add_repairs(kept, add)
        second_pass(kept, sorted(aircraft))
    return repairs_in(store)


def _check_aircraft_known(store: Store, repairs: Repairs) -> None:
    """Refuse repairs of aircraft or actuators that no flight in the store has.

    Raises
    ------
    MavhumsError
        If there is one; then none is stored.
    """
    found = store.query("SELECT DISTINCT aircraft, actuator FROM verdicts WHERE aircraft <> ''").fetchall()
    for repair in repairs:
        aircraft = {name for name, _ in found}
        if repair.aircraft is not None and repair.aircraft not in aircraft:
            raise MavhumsError(f"{store.place}: no aircraft {repair.aircraft}", _there(aircraft))
        actuators = {actuator for name, actuator in found if repair.aircraft in (None, name)}
        if repair.actuator is not None and repair.actuator not in actuators:
            whose = f" of {repair.aircraft}" if repair.aircraft else ""
            raise MavhumsError(f"{store.place}: no actuator {repair.actuator}{whose}", _there(actuators))


def _there(names: set[str]) -> str:
    several = sorted(names)
    return f"the store has: {', '.join(several[:_SHOWN]) or 'none'}{', …' if len(several) > _SHOWN else ''}"
