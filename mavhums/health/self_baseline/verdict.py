"""Compares a verdict with the earlier flights: a pure function of the data stored in verdicts."""

from __future__ import annotations

from collections.abc import Sequence

from mavhums.core.conditions import Condition
from mavhums.core.statistics import ERRORS_95
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.decision.limits import MOST_CONFIDENCE
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.health.estimation.equations import OWN_EQUATIONS, STROKE_EQUATIONS
from mavhums.health.estimation.equations.interface import OwnEquation
from mavhums.health.estimation.wear import mean_load, shows
from mavhums.health.self_baseline.comparison import Comparison, compare
from mavhums.health.self_baseline.motor import (
    MOTOR_FAULTS,
    constant_lost,
    motor_indicators,
)
from mavhums.health.self_baseline.past import record_of
from mavhums.results.reasons import Reason, said
from mavhums.results.verdict import Evidence, Indicator, Interval, OwnRecord, Suspect, Verdict

_OPEN: tuple[Condition, ...] = ("undecided", "learning", "unchanged", "changed")
_CONSTANT = "torque_constant"


def compare_with_own_flights(
    verdict: Verdict, past: Sequence[PastRecord], false_alarms: float = FALSE_ALARMS
) -> Verdict:
    """Return the verdict after the comparison with the actuator's own earlier flights.

    It is unchanged if a limit or a jam decides, and if it has no own-scale record. A verdict that was
    already compared with other flights is judged again.

    Parameters
    ----------
    verdict
        Verdict on a flight.
    past
        All earlier flights of the same actuator, in time order.
    false_alarms
        Allowed false alarms per 100 hours of the actuator.
    """
    # A limit or a jam decides: neither is taken back by what is usual for this servo.
    if not verdict.own or verdict.condition not in _OPEN or verdict.worst not in _OPEN:
        return verdict
    # Whatever else finds a fault closes the verdict: its suspects are of an earlier comparison.
    compared, deciding = without_own(verdict).model_copy(update={"suspects": ()}), _deciding(verdict)
    if deciding is not None:
        compared = _compared(compared, *deciding, past, false_alarms, decides=True)
    for equation in STROKE_EQUATIONS:
        if record := record_of(verdict.own, equation.name):
            compared = _compared(compared, equation, record, past, false_alarms)
    return compared


def _compared(
    verdict: Verdict,
    equation: OwnEquation,
    record: OwnRecord,
    past: Sequence[PastRecord],
    false_alarms: float,
    *,
    decides: bool = False,
) -> Verdict:
    """Return the verdict with one quantity; one that does not decide can make it changed and nothing else."""
    found = compare(equation, record, past, false_alarms)
    changed = found.condition == "changed"
    lost = constant_lost(found, verdict.own, past) if decides and changed else None
    reason = comparison_reason(equation, found, lost)
    shown, why = found.value, said(reason)
    if changed and not decides and verdict.condition == "changed":
        both = f"{verdict.reason}; {reason.text}", f"{verdict.remedy}; {reason.remedy}"
        codes = dict.fromkeys((*verdict.reason_codes, reason.code))
        why = {"reason": both[0], "remedy": both[1], "reason_codes": tuple(codes)}
    indicators = [] if shown is None else [_indicator(equation, record, found, shown)]
    evidence = [] if shown is None else [_evidence(equation, record, found, shown, reason.text)]
    fault = equation.fault if lost is None else _CONSTANT
    suspects = [Suspect(fault=fault, confidence=MOST_CONFIDENCE)] if changed else []
    motor = motor_indicators(verdict.own, past) if decides else ()
    decided = {"condition": found.condition, "worst": found.condition, **why} if decides or changed else {}
    return verdict.model_copy(
        update={
            "indicators": (*verdict.indicators, *indicators, *motor),
            "evidence": (*verdict.evidence, *evidence),
            "suspects": (*verdict.suspects, *suspects),
            **decided,
        }
    )


def without_own(verdict: Verdict) -> Verdict:
    """Return a verdict without the indicators and the evidence of own-scale equations."""
    equations = (*OWN_EQUATIONS, *STROKE_EQUATIONS)
    faults = {*(equation.fault for equation in equations), *MOTOR_FAULTS}
    kinds = {_kind(equation) for equation in equations}
    return verdict.model_copy(
        update={
            "indicators": tuple(shown for shown in verdict.indicators if shown.fault not in faults),
            "evidence": tuple(known for known in verdict.evidence if known.kind not in kinds),
        }
    )


def _deciding(verdict: Verdict) -> tuple[OwnEquation, OwnRecord] | None:
    """Return the most informative equation that this flight shows, or that it has."""
    found = [(one, record) for one in OWN_EQUATIONS if (record := record_of(verdict.own, one.name))]
    # A register's first seconds leave a record of the current, too.
    return next((pair for pair in found if shows(pair[1])), found[0] if found else None)


def _kind(equation: OwnEquation) -> str:
    return f"{equation.fault}_own"


def _indicator(equation: OwnEquation, record: OwnRecord, found: Comparison, value: Interval) -> Indicator:
    windows = len(record.groups)
    error = (value.high - value.low) / 2 / ERRORS_95
    return Indicator(
        fault=equation.fault,
        quantity=equation.quantity,
        unit=equation.unit,
        value=value.significant(5),
        windows=windows,
        scatter=float(f"{error * windows**0.5:.4g}"),
        baseline=found.baseline and found.baseline.significant(5),
        baseline_flights=found.flights,
        needed_flights=found.needed,
        least_rise=None if found.least_rise is None else round(found.least_rise, 4),
        load=None if (load := mean_load(record)) is None else float(f"{load:.4g}"),
    )


def _evidence(
    equation: OwnEquation, record: OwnRecord, found: Comparison, value: Interval, text: str
) -> Evidence:
    return Evidence(
        kind=_kind(equation),
        start_s=0.0,
        end_s=record.duration_s,
        value=float(f"{value.estimate:.5g}"),
        limit=None if found.baseline is None else float(f"{found.baseline.estimate:.5g}"),
        rule=f"{found.condition}: {text}",
    )


def comparison_reason(equation: OwnEquation, found: Comparison, lost: float | None = None) -> Reason:
    """Return the result of a comparison; ``lost`` is the loss of the torque constant that explains it."""
    at_load = "" if found.load is None else f" at a load of {found.load:.2g} {equation.unit}"
    what, change = f"{equation.quantity}{at_load}", found.change
    if found.condition == "learning":
        why = found.why and f", for {found.why}"
        return Reason("own_learning", flight=found.flights, needed=found.needed, why=why)
    if lost is not None:
        rise = "" if change is None else f" {change.estimate:+.0%}"
        return Reason("own_constant", lost=-lost, quantity=f"{equation.quantity}{rise}")
    if change is None:
        return Reason("own_still", quantity=equation.quantity)
    if found.condition == "unchanged":
        sizes = {"half": change.high - change.estimate, "rise": found.least_rise}
        return Reason("own_unchanged", quantity=what, flights=found.flights, **sizes)
    since = f" since flight {found.since.flight} ({found.since.date[:10]})" if found.since else ""
    risen = f"{change.estimate:+.0%} ± {(change.high - change.low) / 2:.0%}{since}"
    return Reason("own_changed", quantity=what, change=risen, cause=equation.cause, inspect=equation.inspect)
