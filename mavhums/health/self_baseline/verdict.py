"""Compares a verdict with the earlier flights: a pure function of the data stored in verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from mavhums.core.conditions import Condition
from mavhums.core.statistics import ERRORS_95
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.decision.limits import MOST_CONFIDENCE
from mavhums.health.decision.thresholds import FALSE_ALARMS, USEFUL_RISE
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
    compared = _by_equation(verdict, past, false_alarms)
    if compared.condition in _OPEN and compared.worst in _OPEN:
        for equation in STROKE_EQUATIONS:
            compared = _beside(compared, equation, past, false_alarms)
    return compared


def _beside(
    verdict: Verdict, equation: OwnEquation, past: Sequence[PastRecord], false_alarms: float
) -> Verdict:
    """Return the verdict with a further quantity, which can make it changed and nothing else."""
    record = record_of(verdict.own, equation.name)
    if record is None:
        return verdict
    found = compare(equation, record, past, false_alarms)
    kept = {
        "indicators": tuple(one for one in verdict.indicators if one.fault != equation.fault),
        "evidence": tuple(one for one in verdict.evidence if one.kind != _kind(equation)),
        "suspects": tuple(one for one in verdict.suspects if one.fault != equation.fault),
    }
    if found.value is None:
        return verdict.model_copy(update=kept)
    reason = comparison_reason(equation, found)
    kept["indicators"] += (_indicator(equation, record, found, found.value),)
    kept["evidence"] += (_evidence(equation, record, found, found.value, reason.text),)
    if found.condition != "changed":
        return verdict.model_copy(update=kept)
    kept["suspects"] += (Suspect(fault=equation.fault, confidence=MOST_CONFIDENCE),)
    why = said(reason)
    if verdict.condition == "changed":
        before = f"{verdict.reason}; {reason.text}", f"{verdict.remedy}; {reason.remedy}"
        codes = dict.fromkeys((*verdict.reason_codes, reason.code))
        why = {"reason": before[0], "remedy": before[1], "reason_codes": tuple(codes)}
    return verdict.model_copy(update={**kept, "condition": "changed", "worst": "changed", **why})


def _by_equation(verdict: Verdict, past: Sequence[PastRecord], false_alarms: float) -> Verdict:
    """Return the verdict after the comparison by its most informative equation."""
    deciding = _deciding(verdict)
    # A limit or a jam decides: neither is taken back by what is usual for this servo.
    if deciding is None or verdict.condition not in _OPEN or verdict.worst not in _OPEN:
        return verdict
    equation, record = deciding
    found = compare(equation, record, past, false_alarms)
    lost = constant_lost(found, verdict.own, past) if found.condition == "changed" else None
    fault = equation.fault if lost is None else _CONSTANT
    reason = comparison_reason(equation, found, lost)
    replaced = (equation.fault, *MOTOR_FAULTS)
    indicators = [shown for shown in verdict.indicators if shown.fault not in replaced]
    evidence = [known for known in verdict.evidence if known.kind != _kind(equation)]
    suspects = [suspect for suspect in verdict.suspects if suspect.fault not in (equation.fault, _CONSTANT)]
    if found.value is not None:
        indicators.append(_indicator(equation, record, found, found.value))
        evidence.append(_evidence(equation, record, found, found.value, reason.text))
    indicators.extend(motor_indicators(verdict.own, past))
    if found.condition == "changed":
        suspects.append(Suspect(fault=fault, confidence=MOST_CONFIDENCE))
    return verdict.model_copy(
        update={
            "condition": found.condition,
            "worst": found.condition,
            "suspects": tuple(suspects),
            "evidence": tuple(evidence),
            "indicators": tuple(indicators),
            **said(reason),
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
        sizes = {"half": change.high - change.estimate, "rise": found.least_rise, "rate": _at_rate(found)}
        return Reason("own_unchanged", quantity=what, flights=found.flights, **sizes)
    since = f" since flight {found.since.flight} ({found.since.date[:10]})" if found.since else ""
    risen = f"{change.estimate:+.0%} ± {(change.high - change.low) / 2:.0%}{since}"
    return Reason("own_changed", quantity=what, change=risen, cause=equation.cause, inspect=equation.inspect)


def _at_rate(found: Comparison) -> str:
    """Return at which rate of false alarms so short or uncertain a flight shows a useful rise."""
    if found.useful_at is None:
        return ""
    if found.useful_at == inf:
        return f", one of {USEFUL_RISE:.0%} at no useful rate of false alarms"
    return f", one of {USEFUL_RISE:.0%} at {found.useful_at:.2g} false alarms in 100 h"
