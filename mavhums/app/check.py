"""Check before a flight: what surfaces that are swept on the ground show of their servos.

An aircraft at rest has no aerodynamic load, and a sweep is the same motion each time. The strokes at constant
speed of a vehicle that is not armed, or armed but landed and still, show the travel and the speed that are
reached, what the angle lags behind either way, roughness, and the friction in a current.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from mavhums.actuator.mapping import MappedSamples, VehicleMappers, messages_for
from mavhums.actuator.profile import Airframe, load_airframe
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MavhumsError
from mavhums.engine.axes import Axes
from mavhums.health.estimation.slots import SlotCutter, with_extra_columns
from mavhums.health.estimation.strokes import Stroke, Strokes, pairs_of
from mavhums.log import Decoder, Table, decode_blocks
from mavhums.vehicle.clocks import Clocks
from mavhums.vehicle.facts import ON_GROUND
from mavhums.vehicle.signals import SIGNAL_MESSAGES, SignalReader
from mavhums.vehicle.states import TEXT_MESSAGES

LEAST_STROKES: Final = 2
"""Strokes that make a sweep: one out, one back."""
LEAST_SHARE: Final = 0.95
"""Share of the commanded travel, and of its speed, that a servo must reach: gears twist under their own
friction, but not by more than a degree in twenty. By hand."""
STILL_M_S: Final = 2.0
"""Ground speed below which an armed aircraft that reports that it has landed is at rest: a receiver at rest
shows less, a take-off run more. By hand."""
_ARMED: Final = 2  # column of the state


@dataclass(frozen=True, slots=True)
class Sweep:
    """What the sweeps of one actuator on the ground show; None where it is not measured.

    Attributes
    ----------
    vehicle, actuator
        System id, and the actuator of the profile.
    strokes
        Number of strokes at constant speed.
    commanded_deg, reached_deg
        Least and greatest angle.
    commanded_deg_s, reached_deg_s
        Median speed of the strokes.
    hysteresis_deg
        Half the difference of the position errors of the two ways: play, friction and lag together.
    roughness_deg
        Root mean square of the position error in steady motion, a cubic taken off.
    friction_a
        Half-sum of the currents either way over that at rest.
    armed_known
        Whether the log records when the vehicle was armed; else its whole time counts.
    faults
        What the sweep did not reach, in words.
    """

    vehicle: int
    actuator: str
    strokes: int
    commanded_deg: tuple[float, float]
    reached_deg: tuple[float, float] | None
    commanded_deg_s: float
    reached_deg_s: float | None
    hysteresis_deg: float | None
    roughness_deg: float | None
    friction_a: float | None
    armed_known: bool
    faults: tuple[str, ...]

    def as_text(self) -> str:
        """Return the sweep as text, in two lines."""
        shown = [f"{self.strokes} strokes at {self.commanded_deg_s:.3g} °/s"]
        if self.reached_deg:
            shown.append(f"reaches {self.reached_deg[0]:.1f} to {self.reached_deg[1]:.1f}°")
        for name, value, unit in (
            ("hysteresis", self.hysteresis_deg, "°"),
            ("roughness", self.roughness_deg, "°"),
            ("friction", self.friction_a, " A"),
        ):
            shown += [] if value is None else [f"{name} {value:.3g}{unit}"]
        state = "" if self.armed_known else " (the log does not record when it was armed)"
        return f"{self.actuator}: {'; '.join(self.faults) or 'ok'}{state}\n  {', '.join(shown)}"


_RESTS: Final[Mapping[str, Callable[[Array], Flags]]] = {
    "state": lambda values: values[:, _ARMED] <= 0,
    "landed": lambda values: values[:, 0] == ON_GROUND,
    "groundspeed": lambda values: values[:, 0] < STILL_M_S,
}
"""Which values of a signal show that a vehicle is at rest on the ground."""


class _Ground:
    """When each vehicle is at rest on the ground, as far as the log records it."""

    def __init__(self) -> None:
        self._signals = SignalReader()
        self._changes: dict[tuple[int, str], tuple[list[int], list[bool]]] = {}

    def feed(self, tables: Mapping[str, Table]) -> None:
        for signal in self._signals.read(tables):
            if signal.name in _RESTS:
                rests = _RESTS[signal.name](signal.values)
                changes = np.append(True, np.diff(rests))
                times, states = self._changes.setdefault((signal.vehicle, signal.name), ([], []))
                times += signal.time_us[changes].tolist()
                states += rests[changes].tolist()

    def known(self, vehicle: int) -> bool:
        """Return whether the log records when the vehicle was armed."""
        return (vehicle, "state") in self._changes

    def on_ground(self, vehicle: int, utc_us: Integers) -> Flags:
        """Return which times are on the ground: disarmed, or landed and still; all if arming is unknown."""
        if not self.known(vehicle):
            return np.ones(utc_us.size, dtype=np.bool_)
        landed, still = (self._state_at(vehicle, name, utc_us) for name in ("landed", "groundspeed"))
        return self._state_at(vehicle, "state", utc_us) | (landed & still)

    def _state_at(self, vehicle: int, name: str, utc_us: Integers) -> Flags:
        times, states = self._changes.get((vehicle, name), ([0], [False]))
        place = np.searchsorted(times, utc_us, side="right") - 1
        # Before the first word the state is that word's.
        return np.array(states)[np.maximum(place, 0)]


def check_log(
    path: str | os.PathLike[str],
    *,
    airframe: Airframe | str | Path | None = None,
    dialect: str | os.PathLike[str] | None = None,
    progress: Callable[[int], None] | None = None,
) -> list[Sweep]:
    """Return what the sweeps on the ground of each actuator show.

    Parameters
    ----------
    path
        A log of any format.
    airframe
        A profile, its name or its path; if None, each vehicle's own, if the log names it or holds its
        parameters.
    dialect
        A MAVLink XML file whose definitions take precedence over the shipped ones.
    progress
        Called with the number of bytes read after each block.

    Raises
    ------
    MavhumsError
        If the log or the profile cannot be read, or no surface is swept on the ground.
    """
    given = None if airframe is None else load_airframe(airframe)
    wanted = messages_for(given.actuators if given else ()) | SIGNAL_MESSAGES | TEXT_MESSAGES
    decoder, clocks, ground = Decoder(wanted, dialect=dialect), Clocks(), _Ground()
    fleet, axes = VehicleMappers(given), Axes(given)
    tracks: dict[tuple[int, str], tuple[SlotCutter, Strokes]] = {}
    for read, _, final in decode_blocks(path, decoder, dialect=dialect, progress=progress):
        tables = clocks.feed(read)
        ground.feed(tables)
        for said, named in fleet.listen(tables):
            if named is not None:
                axes.announce(said.vehicle, said.frame, named)
        deque(axes.feed(tables, decoder.first_time_us or 0, final=final), maxlen=0)
        for draft in axes.drafted():
            fleet.use(draft)
        for _, mapped in fleet.feed(tables, final=final):
            key = mapped.vehicle, mapped.actuator.name
            track = tracks.setdefault(key, (SlotCutter(), Strokes(mapped.actuator)))
            _feed(track, mapped, ground, decoder.first_time_us or 0)
    found = []
    for (vehicle, name), (cutter, strokes) in sorted(tracks.items()):
        slots = cutter.finish()
        if slots is not None:
            strokes.feed(slots)
        if sum(stroke.way != 0.0 for stroke in strokes.strokes) >= LEAST_STROKES:
            found.append(_sweep(vehicle, name, strokes.strokes, ground.known(vehicle)))
    if not found:
        raise MavhumsError(
            f"{path}: no surface is swept on the ground: "
            "none moves at constant speed while the vehicle rests",
            "sweep the surfaces at constant speed, out and back, before take-off, and record V1 and V3",
        )
    return found


def _feed(track: tuple[SlotCutter, Strokes], mapped: MappedSamples, ground: _Ground, first_us: int) -> None:
    rows = ground.on_ground(mapped.vehicle, mapped.utc_us)
    if not rows.any():
        return
    time_s = (mapped.utc_us[rows] - first_us) / 1e6
    slots = track[0].feed(time_s, with_extra_columns(mapped.values[rows], mapped.measured[rows]))
    if slots is not None:
        track[1].feed(slots)


def _sweep(vehicle: int, name: str, strokes: Sequence[Stroke], armed_known: bool) -> Sweep:
    moving = [stroke for stroke in strokes if stroke.way]
    commanded, reached = (
        _range([getattr(one, what) for one in strokes]) for what in ("commanded", "reached")
    )
    speed = float(np.median([abs(one.commanded_deg_s) for one in moving]))
    reached_speed = _finite(np.median([abs(one.reached_deg_s) for one in moving]))
    errors = [[one.error for one in moving if one.way == way] for way in (1.0, -1.0)]
    apart = _finite((np.mean(errors[0]) - np.mean(errors[1])) / 2) if all(errors) else None
    rest = [one.current for one in strokes if not one.way and np.isfinite(one.current)]
    both = [u for u, _ in pairs_of(strokes)]
    return Sweep(
        vehicle=vehicle,
        actuator=name,
        strokes=len(moving),
        commanded_deg=commanded or (np.nan, np.nan),
        reached_deg=reached,
        commanded_deg_s=speed,
        reached_deg_s=reached_speed,
        hysteresis_deg=apart,
        roughness_deg=_finite(np.mean([one.rough for one in moving])),
        friction_a=_finite(np.mean(both) - np.median(rest)) if both and rest else None,
        armed_known=armed_known,
        faults=_faults(commanded, reached, speed, reached_speed),
    )


def _faults(
    commanded: tuple[float, float] | None,
    reached: tuple[float, float] | None,
    speed: float,
    reached_speed: float | None,
) -> tuple[str, ...]:
    found = []
    if commanded and reached:
        travel, way = reached[1] - reached[0], commanded[1] - commanded[0]
        if travel < LEAST_SHARE * way:
            found.append(f"reaches {travel:.3g}° of the {way:.3g}° commanded")
    if reached_speed is not None and reached_speed < LEAST_SHARE * speed:
        found.append(f"moves at {reached_speed:.3g} °/s where {speed:.3g} °/s are commanded")
    return tuple(found)


def _range(several: Sequence[Array]) -> tuple[float, float] | None:
    known = np.concatenate(several)
    known = known[np.isfinite(known)]
    return (float(known.min()), float(known.max())) if known.size else None


def _finite(value: float | np.floating) -> float | None:
    return float(value) if np.isfinite(value) else None
