"""Which outputs move an axis, by the aircraft's response, where no parameter of the log says so.

*A profile names outputs.* A wrong profile looks like a lost surface: the demand that its outputs give is not
the one that moves the aircraft. So in the first minutes each output that moves is tried as the demand of the
axis. An output that explains the motion much worse than another one does not move the axis. Outputs that move
together, as rudder and aileron do in coordinated flight, look alike then. So an alarm is tested
against other outputs, too: where one of them explains the same seconds without any loss, the surface is not
lost.

*Nothing names outputs.* They are inferred. Roll: the output to which the roll rate responds, and the outputs
that move as one with it. Pitch: the one other output to which the pitch acceleration responds, if no second
output is nearly as good. A rudder cannot be inferred in this way: it mostly moves with the ailerons. An
inference must be the only one that the flight allows. Elevons move with pitch as well, so that another output
explains what one of them leaves; a rudder that an autopilot mixes with the roll demand of elevons is the
difference of two other outputs. Neither is taken for an aileron.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple, TypeGuard

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums.core.conditions import SEVERITY
from mavhums.health.axis.effectiveness import EffectivenessTracker
from mavhums.health.axis.explained import explained_by
from mavhums.health.axis.monitor import AxisMonitor
from mavhums.health.axis.thresholds import NORMAL_EFFECTIVENESS
from mavhums.health.decision.events import ConditionChanged, Indication
from mavhums.results.sections import AxisLimits
from mavhums.vehicle.facts import OUTPUTS
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.rows import Rows
from mavhums.vehicle.surfaces import ALIKE_US, AXES, SurfaceOutput, Surfaces

TRIED_AXES: Final = ("roll", "pitch")  # a rudder mostly moves with the ailerons

_MOVES_US: Final = 10.0  # standard deviation: less is trim and noise, from which a slope follows by chance
_MOVES_SHARE: Final = 0.9  # of the rows: an output that is off for longer shows no flight
_HALF_US: Final = 400.0
"""Half of the usual travel, 1100 to 1900 µs: the scale of a demand, which no share depends on."""
_AS_ONE: Final = 0.99  # share of the rows in which outputs with one demand differ by less than ALIKE_US
_ROLLS_RAD_S: Final = 0.05  # deviation of the roll rate: without turns any slow output explains what is left
_LEAST_SHARE: Final = {"roll": 0.6, "pitch": 0.35}
"""Share of the motion that an output must explain to be the one that moves the axis. In roll, lower takes
other outputs for ailerons; in pitch, the share of the acceleration, gusts and speed count as well."""
_APART: Final = 2.0  # the second best output leaves so many times as much, or explains so many times less
_MIXED: Final = 0.4
"""Share of what ailerons leave that others explain: up to 0.35 in development, of elevons from 0.48."""
_DOUBLE: Final = 0.95  # share of a demand that other outputs carry as well

_WORSE: Final = 0.75
"""Part of the best output's share below which another one does not move the axis. In 49 flights of ArduPlane
in software-in-the-loop an aileron had 0.98 of it or more, an elevator at most 0.6 in roll, a rudder any."""

_ALIKE: Final = 0.97  # correlation of outputs that move together
_SHOWN_ROWS: Final = 10 * RATE_HZ  # before an alarm: the windows in which a loss is certain


def _with_demand(rows: Rows, axis: str, demand: Array) -> Rows:
    """Return the rows with a demand, shape (n,), about one axis alone."""
    outputs = np.full_like(rows.outputs, np.nan)
    outputs[:, AXES.index(axis)] = demand
    return replace(rows, outputs=outputs)


def _explained(rows: Rows, axis: str, demand: Array) -> float:
    """Return how much of the motion about an axis a demand, shape (n,), explains: a share from 0 to 1."""
    gain = EffectivenessTracker(axis)
    gain.feed(_with_demand(rows, axis, demand))
    found = gain.reference or gain.best
    return 0.0 if found is None else found.explained


def contradiction(rows: Rows, pulses: Array, axis: str, outputs: Sequence[SurfaceOutput]) -> str | None:
    """Return which of a profile's outputs do not move an axis; an empty text if all do, None if not clear.

    Parameters
    ----------
    rows
        Rows of forward flight, with the demand that the profile's outputs make.
    pulses
        Pulses of all outputs over the same rows, µs, shape (n, outputs).
    axis
        ``roll`` or ``pitch``.
    outputs
        The profile's outputs of the axis.
    """
    moving = [k for k in range(pulses.shape[1]) if _moves(pulses[rows.flying, k])]
    shares = {k + 1: _explained(rows, axis, _alone(pulses, k, outputs)) for k in moving}
    best = max(shares, key=shares.__getitem__, default=None)
    if best is None or shares[best] < _LEAST_SHARE[axis]:
        return None
    named = [one.servo for one in outputs if one.servo in shares]
    own = max(named, key=shares.__getitem__, default=None)
    together = _explained(rows, axis, rows.demand(axis))  # of elevons, each alone explains less
    if own is None or max(shares[own], together) < _WORSE * shares[best]:
        wrong, movers = [one.servo for one in outputs], [k for k in shares if _alike(rows, pulses, k, best)]
    else:
        worse = [servo for servo in named if shares[servo] < _WORSE * shares[own]]
        wrong = [servo for servo in worse if not _alike(rows, pulses, servo, own)]
        movers = [servo for servo in named if servo not in wrong]
    return _contradiction_text(axis, wrong, sorted(movers)) if wrong else ""


def refutation(
    rows: Rows, pulses: Array, axis: str, outputs: Sequence[SurfaceOutput], limits: AxisLimits
) -> str:
    """Return which outputs move an axis by which the profile's raise an alarm; an empty text if none does.

    The alarm must come from these very rows, the last ones before it. That another output raises none is no
    proof: a rudder that moves with the ailerons loses as much of its response as they do, and may only need
    longer to show it. Another output refutes where the last ten seconds surely show its response whole.
    Parameters are those of :func:`contradiction`.
    """
    if not _judged(rows, axis, rows.demand(axis), limits).alarmed:
        return ""
    alone = {
        k + 1: _alone(pulses, k, outputs) for k in range(pulses.shape[1]) if _moves(pulses[rows.flying, k])
    }
    # An output at rest while the loss is seen raises no alarm because it shows nothing: its own surface
    # may be the lost one (two ALFA flights whose aileron stops with its output): it is no wrong one either.
    usable = {servo: demand for servo, demand in alone.items() if np.isfinite(demand[-_SHOWN_ROWS:]).all()}
    tried = {servo: _judged(rows, axis, demand, limits) for servo, demand in usable.items()}
    movers = [servo for servo, found in tried.items() if found.whole and not found.alarmed]
    silent = alone.keys() - usable.keys()
    wrong = [one.servo for one in outputs if one.servo not in movers and one.servo not in silent]
    return _contradiction_text(axis, wrong, movers) if wrong and movers else ""


class _DemandCheck(NamedTuple):
    """Whether the last seconds of a demand show its whole response, and whether it raised an alarm."""

    whole: bool
    alarmed: bool


def _judged(rows: Rows, axis: str, demand: Array, limits: AxisLimits) -> _DemandCheck:
    events = [*AxisMonitor(0, limits).feed(_with_demand(rows, axis, demand))]
    shown = [e for e in events if isinstance(e, Indication) and e.actuator == axis]
    whole = bool(shown) and bool(shown[-1].low[-1] > NORMAL_EFFECTIVENESS)
    return _DemandCheck(whole, any(rests_on_outputs(event) for event in events))


def rests_on_outputs(event: object) -> TypeGuard[ConditionChanged]:
    """Return whether an event is an alarm that the outputs' demand brought about, not the attitude alone."""
    if not isinstance(event, ConditionChanged) or event.fault == "tracking":
        return False
    return SEVERITY[event.after] > SEVERITY["normal"]


def _alone(pulses: Array, k: int, outputs: Sequence[SurfaceOutput]) -> Array:
    """Return an output alone as a demand; NaN while it rests and another one of its group moves.

    An output that is overridden no longer shows the demand, and it may be its surface that has failed.
    """
    demand: Array = (pulses[:, k] - float(np.nanmedian(pulses[:, k]))) / _HALF_US
    columns = [one.servo - 1 for one in outputs]
    if k not in columns:
        return demand
    steps = np.diff(pulses[:, columns], axis=0, prepend=pulses[:1, columns])
    at = np.where(np.isfinite(steps) & (steps != 0.0), np.arange(len(pulses))[:, None], 0)
    changed = np.maximum.accumulate(at, axis=0)
    rests = changed.max(axis=1) - changed[:, columns.index(k)] >= RATE_HZ
    return np.where(rests, np.nan, demand)


def _alike(rows: Rows, pulses: Array, one: int, other: int) -> bool:
    """Return whether two outputs always move together, in either direction."""
    both = pulses[rows.flying][:, [one - 1, other - 1]]
    both = both[np.isfinite(both).all(axis=1)]
    return one == other or abs(float(np.corrcoef(both[:, 0], both[:, 1])[0, 1])) >= _ALIKE


def _contradiction_text(axis: str, wrong: Sequence[int], movers: Sequence[int]) -> str:
    """Return a contradiction in the motion as a clause."""
    first, but = ("servo", "does") if len(wrong) == 1 else ("servos", "do")
    then = f"servo {movers[0]} does" if len(movers) == 1 else f"servos {_listed(movers)} do"
    return f"{first} {_listed(wrong)} {but} not move {axis}, {then}: the profile may name the wrong output"


def _listed(servos: Sequence[int]) -> str:
    *most, last = map(str, servos)
    return f"{', '.join(most)} and {last}" if most else last


def inferred(rows: Rows, pulses: Array) -> Surfaces | None:
    """Return the surfaces inferred from the flight; None if not even the ailerons are clear.

    Parameters
    ----------
    rows
        Rows of forward flight, with turns.
    pulses
        Pulses of the outputs over the same rows, µs, shape (n, OUTPUTS).
    """
    moving = [k for k in range(OUTPUTS) if _moves(pulses[rows.flying, k])]
    flying = rows.flying & np.isfinite(pulses[:, moving]).all(axis=1) & np.isfinite(rows.roll_rate)
    if not moving or not flying.any() or float(rows.roll_rate[flying].std()) < _ROLLS_RAD_S:
        return None
    demands = {k: (pulses[:, k] - float(np.median(pulses[flying, k]))) / _HALF_US for k in moving}
    none = np.empty((len(rows), 0))
    rolls = {k: explained_by("roll", rows, demands[k], none)[0] for k in moving}
    best = max(rolls, key=rolls.__getitem__)
    slopes = {k: _slope(demands[k][flying], demands[best][flying]) for k in moving}
    alike = [k for k in moving if _are_one(demands[k][flying], slopes[k] * demands[best][flying])]
    others = [k for k in moving if k not in alike]
    beside = np.column_stack([none, *(demands[k] for k in others)])
    second = max((rolls[k] for k in others), default=0.0)
    if rolls[best] < _LEAST_SHARE["roll"] or 1.0 - second < _APART * (1.0 - rolls[best]):
        return None
    if _carried(demands[best][flying], beside[flying]):
        return None
    if explained_by("roll", rows, demands[best], beside)[1] > _MIXED:
        return None
    found = [_moved(k, "aileron", pulses, flying, slopes[k]) for k in alike]
    rest = {k: explained_by("pitch", rows, demands[k], none)[0] for k in others}
    order = sorted(rest, key=rest.__getitem__, reverse=True)
    clear = len(order) < 2 or rest[order[0]] > _APART * rest[order[1]]
    if order and clear and rest[order[0]] >= _LEAST_SHARE["pitch"]:
        found.append(_moved(order[0], "elevator", pulses, flying, 1.0))
    return Surfaces(tuple(found), "inferred")


def _moves(pulses: Array) -> bool:
    """Return whether an output moves, from its pulses over the rows of flight, µs, shape (n,)."""
    if not pulses.size or np.isfinite(pulses).mean() <= _MOVES_SHARE:
        return False
    return float(np.nanstd(pulses)) > _MOVES_US


def _slope(pulses: Array, best: Array) -> float:
    """Return how far an output moves for each microsecond of the best one, signed.

    Outputs that move together then give the same demand, so that one of them that stops changes nothing.
    """
    return float(pulses @ best) / float(best @ best)


def _are_one(demand: Array, expected: Array) -> bool:
    """Return whether two outputs carry one demand."""
    return bool((np.abs(demand - expected) * _HALF_US <= ALIKE_US).mean() >= _AS_ONE)


def _carried(demand: Array, others: Array) -> bool:
    """Return whether other outputs together carry nearly the same demand."""
    if not others.size:
        return False
    left = demand - others @ np.linalg.lstsq(others, demand, rcond=None)[0]
    return float(left @ left) <= (1.0 - _DOUBLE) * float(demand @ demand)


def _moved(k: int, surface: str, pulses: Array, flying: Flags, slope: float) -> SurfaceOutput:
    return SurfaceOutput(k + 1, surface, float(np.median(pulses[flying, k])), slope * _HALF_US)
