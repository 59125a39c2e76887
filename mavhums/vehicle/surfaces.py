"""The outputs that demand roll, pitch and yaw, and the size of the demand, for any mixing.

Elevons and V-tails are unmixed. If several outputs have the same function, those that still change give the
demand: an output that is stuck while the others move does not show the demand.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array
from mavhums.vehicle.facts import ALL_OUTPUTS
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.parameters import Parameters, assigned_outputs, control_surfaces
from mavhums.vehicle.vtol import NO_LIFT, Lift, lift_of

AXES: Final = ("roll", "pitch", "yaw")
STEERING: Final = "steering"
"""The only axis of a rover or a boat, and what its servo moves: it turns the vehicle about yaw."""
COLUMNS: Final[Mapping[str, int]] = {"roll": 0, "pitch": 1, "yaw": 2, STEERING: 2}
"""The column of each axis in what is demanded about roll, pitch and yaw."""

KINDS: Final = ("flaperon", "aileron", "elevon", "elevator", "rudder", "tail", STEERING)
_ROVERS: Final = "CRUISE_THROTTLE"
"""A parameter of each ArduPilot rover and boat, and of nothing else: nose wheels steer by a servo, too."""
_PX4_ACKERMANN, _PX4_DIFFERENTIAL = 5, 6  # CA_AIRFRAME
_PX4_STEERING: Final = 201  # PWM_MAIN_FUNCn: the first servo
_WHEELS: Final = ("left throttle", "right throttle")
_MIXED: Final = ("elevon", "tail")
_FROZEN_S: Final = 1.0
"""An output that rests for as long while others of its surface move is stuck: in flight all of them move."""
ALIKE_US: Final = 3.0
"""Outputs with the same demand differ by less: they are whole microseconds, and so are their trims."""


class SurfaceOutput(NamedTuple):
    """An output that moves a surface: 0 at ``zero_us``, ±1 at ``zero_us`` ± ``half_us``, which has a sign."""

    servo: int
    surface: str
    zero_us: float
    half_us: float

    @property
    def kind(self) -> str:
        """The kind of surface: one of aileron, flaperon, elevon, elevator, rudder, tail, steering."""
        return next(kind for kind in KINDS if kind in self.surface)

    @property
    def range_us(self) -> tuple[int, int, int]:
        """Smallest, zero and largest pulse."""
        half = abs(self.half_us)
        return round(self.zero_us - half), round(self.zero_us), round(self.zero_us + half)

    @property
    def side(self) -> str:
        """Return ``left`` or ``right``, or an empty text if the side is unknown."""
        return next((side for side in ("left", "right") if side in self.surface), "")


@dataclass(frozen=True, slots=True)
class Surfaces:
    """The outputs of a vehicle that move its surfaces.

    Attributes
    ----------
    moved
        The outputs.
    origin
        Source of the outputs: ``parameters``, ``profile`` or ``inferred``.
    lift
        What carries the vehicle when it hovers.
    by_log
        Axes whose outputs the log's parameters give although ``origin`` is a profile.
    contradicted
        What contradicts the profile's outputs, by axis. Such an axis has those of the log's parameters, or
        none.
    confirmed
        Axes for whose outputs the log's parameters say the same as the profile.
    """

    moved: tuple[SurfaceOutput, ...]
    origin: str
    lift: Lift = NO_LIFT
    by_log: frozenset[str] = frozenset()
    contradicted: Mapping[str, str] = field(default_factory=dict)
    confirmed: frozenset[str] = frozenset()

    @property
    def axes(self) -> tuple[str, ...]:
        """The axes that they turn the vehicle about."""
        steers = bool(self.moved) and all(one.kind == STEERING for one in self.moved)
        return (STEERING,) if steers else AXES

    def of_axis(self, axis: str) -> tuple[SurfaceOutput, ...]:
        """Return the outputs that move the aircraft about an axis; none if they are contradicted."""
        if axis in self.contradicted and axis not in self.by_log:
            return ()
        kinds = {
            "roll": ("aileron", "flaperon", "elevon"),
            "pitch": ("elevator", "elevon", "tail"),
            "yaw": ("rudder", "tail"),
            STEERING: (STEERING,),
        }[axis]
        for kind in kinds:
            found = tuple(moved for moved in self.moved if moved.kind == kind)
            if found:
                return found
        return ()

    @property
    def mixed(self) -> Mapping[str, str]:
        """The other axis of each that two mixed surfaces move, where it distinguishes the two surfaces.

        What a demand in pitch does to the side force of a V-tail depends on how the aircraft then slips.
        """
        for kind, found in (("elevon", {"roll": "pitch", "pitch": "roll"}), ("tail", {"pitch": "yaw"})):
            sides = [{one.side for one in self.of_axis(axis) if one.kind == kind} for axis in found]
            if all(each == {"left", "right"} for each in sides):
                return found
        return {}

    def same_outputs(self, other: Surfaces) -> bool:
        """Return whether the same outputs move the same surfaces the same way, by whatever ranges."""
        own, others = (
            {(moved.servo, moved.surface, moved.half_us > 0) for moved in each.moved}
            for each in (self, other)
        )
        return own == others and self.lift.servos == other.lift.servos

    def demand(self, axis: str) -> tuple[tuple[object, ...], ...]:
        """Return what the demand about an axis is made of, whatever the names of the surfaces."""
        moved = self.of_axis(axis)
        return tuple((one.kind, one.side * (one.kind in _MIXED), one.servo, *one[2:]) for one in moved)

    @property
    def demands(self) -> tuple[object, ...]:
        """What decides the demand of every row and where the vehicle hovers, whatever the surfaces' names."""
        return self.origin == "inferred", self.lift, *(self.demand(axis) for axis in self.axes)

    def brief(self, axis: str) -> str:
        """Return the surfaces of an axis in few letters, for an alert; an empty text if there are none.

        Examples
        --------
        >>> left = SurfaceOutput(1, "left aileron", 1500, 500)
        >>> ailerons = left, SurfaceOutput(2, "right aileron", 1500, 500)
        >>> Surfaces(ailerons, "profile").brief("roll")
        'aileron L/R'
        """
        moved = self.of_axis(axis)
        if moved and self.origin == "inferred":
            return f"servo {'/'.join(str(one.servo) for one in moved)}"
        if len(moved) < 2:
            return moved[0].kind if moved else ""
        marks = [one.side[:1].upper() or str(one.servo) for one in moved]
        return f"{moved[0].kind} {'/'.join(marks)}"

    def names(self, axis: str) -> tuple[str, ...]:
        """Return the surfaces of an axis, each with its servo."""
        return tuple(map(self.named, self.of_axis(axis)))

    def named(self, moved: SurfaceOutput) -> str:
        """Return what is known of an output: its surface, or of an inferred one what the motion shows.

        Examples
        --------
        >>> one = SurfaceOutput(4, "aileron", 1500, 500)
        >>> Surfaces((one,), "profile").named(one), Surfaces((one,), "inferred").named(one)
        ('aileron (servo 4)', 'servo 4 (moves with roll)')
        """
        if self.origin != "inferred":
            return f"{moved.surface} (servo {moved.servo})"
        return f"servo {moved.servo} ({self.what(moved)})"

    def what(self, moved: SurfaceOutput) -> str:
        """Return the surface of an output, or of an inferred one the axis that it moves with.

        An output that the roll rate answers to may be a rudder's: in turns both move together.
        """
        if self.origin != "inferred":
            return moved.surface
        return f"moves with {next(axis for axis in AXES if moved in self.of_axis(axis))}"


def of_parameters(parameters: Parameters) -> Surfaces | None:
    """Return the surfaces that an autopilot's parameters define; None if they define none."""
    values = parameters.values
    if steering := tuple(_steering(parameters)):
        return Surfaces(steering, "parameters")
    found = []
    for output in control_surfaces(parameters):
        # Without its zero, its ends and its direction, what an output demands is not known.
        if output.lacks:
            continue
        surface = output.surface.replace("v-tail", "tail").replace("a-tail", "tail")
        if output.servo > ALL_OUTPUTS or not any(kind in surface for kind in KINDS):
            continue
        low, zero, high = output.pwm_us
        sign = _px4_sign(output.because, surface, values) if parameters.is_px4 else 1.0
        sign = -sign if output.is_reversed else sign
        found.append(SurfaceOutput(output.servo, surface, zero, sign * (high - low) / 2))
    return Surfaces(tuple(found), "parameters", lift_of(values)) if found else None


def _steering(parameters: Parameters) -> Iterator[SurfaceOutput]:
    """Yield the outputs that steer a rover or a boat."""
    values = parameters.values
    if parameters.is_px4 and values.get("CA_AIRFRAME") != _PX4_ACKERMANN:
        return
    if not parameters.is_px4 and _ROVERS not in values:
        return
    for output in assigned_outputs(parameters):
        steers = output.surface == "ground steering"
        if parameters.is_px4:
            steers = f"= {_PX4_STEERING}" in output.because
        if steers and output.servo <= ALL_OUTPUTS and not output.lacks:
            low, zero, high = output.pwm_us
            yield SurfaceOutput(
                output.servo, STEERING, zero, (-1 if output.is_reversed else 1) * (high - low) / 2
            )


def steers_by_wheels(parameters: Parameters) -> bool:
    """Return whether a rover or a boat steers by the difference of its motors.

    Examples
    --------
    >>> tank = {"CRUISE_THROTTLE": 50.0, "SERVO1_FUNCTION": 73.0, "SERVO3_FUNCTION": 74.0}
    >>> steers_by_wheels(Parameters(1, False, tank))
    True
    """
    if parameters.is_px4:
        return parameters.values.get("CA_AIRFRAME") == _PX4_DIFFERENTIAL
    driven = {output.surface for output in assigned_outputs(parameters)}
    return _ROVERS in parameters.values and driven.issuperset(_WHEELS)


def _px4_sign(because: str, surface: str, values: Mapping[str, float]) -> float:
    """Return the sign of a PX4 output about its own axis, from its torque or else from its side."""
    surface_number = because.partition("CA_SV_CS")[2].partition("_")[0]
    letter = "R" if "aileron" in surface else "Y" if "rudder" in surface else "P"
    torque = values.get(f"CA_SV_CS{surface_number}_TRQ_{letter}", 0.0)
    if torque:
        return -1.0 if torque < 0 else 1.0
    return -1.0 if surface == "left aileron" else 1.0


class Demands:
    """Follows the demand of the outputs about each axis, from one set of grid rows to the next.

    Outputs that were inferred count as one demand only as long as they move as one: where they part, one of
    them moves something else, and the demand is unknown.

    Parameters
    ----------
    surfaces
        The outputs in use.

    Attributes
    ----------
    parted
        Of the last rows, those in which inferred outputs do not move as one, (n,).
    """

    def __init__(self, surfaces: Surfaces) -> None:
        self._inferred = surfaces.origin == "inferred"
        self.parted = np.zeros(0, dtype=bool)
        self._groups: dict[str, list[SurfaceOutput]] = {}
        for axis in surfaces.axes:
            for moved in surfaces.of_axis(axis):
                name = f"{moved.side} {moved.kind}" if moved.kind in _MIXED else moved.kind
                members = self._groups.setdefault(name, [])
                if moved not in members:
                    members.append(moved)
        known = {COLUMNS[axis] for axis in surfaces.axes if surfaces.of_axis(axis)}
        self._none = [k for k in range(len(AXES)) if k not in known]
        self._row = 0
        self._before = {name: np.full(len(group), np.nan) for name, group in self._groups.items()}
        self._changed = {name: np.zeros(len(group), dtype=np.int64) for name, group in self._groups.items()}

    def feed(self, pulses: Array) -> Array:
        """Return the demand about roll, pitch and yaw, (n, 3), from all outputs' pulses; NaN if unknown."""
        self.parted = np.zeros(len(pulses), dtype=bool)
        known = {name: self._demand(name, group, pulses) for name, group in self._groups.items()}
        self._row += len(pulses)
        none = np.full(len(pulses), np.nan)
        elevons = [known.get(f"{side} elevon", none) for side in ("left", "right")]
        tails = [known.get(f"{side} tail", none) for side in ("left", "right")]
        roll = _first(known, "aileron", "flaperon", other=(elevons[0] - elevons[1]) / 2)
        mixed = elevons if any("elevon" in name for name in known) else tails
        pitch = _first(known, "elevator", other=(mixed[0] + mixed[1]) / 2)
        yaw = _first(known, "rudder", STEERING, other=(tails[0] - tails[1]) / 2)
        demand = np.stack([roll, pitch, yaw], axis=1)
        demand[:, self._none] = np.nan  # mixed outputs may be contradicted about one of their axes
        return demand

    def _demand(self, name: str, group: Sequence[SurfaceOutput], pulses: Array) -> Array:
        """Return the median of a group's outputs that still change, as a fraction of half the travel."""
        columns = [moved.servo - 1 for moved in group]
        zero, half = (np.array([moved[k] for moved in group]) for k in (2, 3))
        share = (pulses[:, columns] - zero) / half
        steps = np.diff(np.vstack([self._before[name], share]), axis=0)
        rows = self._row + np.arange(len(share))[:, None]
        changed = np.where(np.isfinite(steps) & (steps != 0.0), rows, 0)
        changed = np.maximum.accumulate(np.maximum(changed, self._changed[name]), axis=0)
        stuck = changed.max(axis=1, keepdims=True) - changed >= _FROZEN_S * RATE_HZ
        self._before[name], self._changed[name] = share[-1], changed[-1]
        # With one output, or a mixed one, nothing distinguishes a stuck output from one that is held.
        if "elevon" in name or "tail" in name or len(group) == 1:
            stuck[:] = False
        share = np.where(stuck, np.nan, share)
        demand = _median(share)
        if self._inferred:
            apart = np.nan_to_num(np.abs(share - demand[:, None]) * np.abs(half)).max(axis=1) > ALIKE_US
            self.parted |= apart
            demand[apart] = np.nan
        return demand


def _median(values: Array) -> Array:
    """Return the median of each row without NaN: of three outputs, one that jumps alone does not count."""
    ordered = np.sort(values, axis=1)  # NaN last
    number = np.isfinite(values).sum(axis=1)
    rows, last = np.arange(len(values)), np.maximum(number, 1)
    middle: Array = (ordered[rows, (last - 1) // 2] + ordered[rows, last // 2]) / 2
    return middle


def _first(known: Mapping[str, Array], *names: str, other: Array) -> Array:
    return next((known[name] for name in names if name in known), other)
