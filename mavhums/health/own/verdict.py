"""Compares a verdict with the earlier flights: a pure function of the data stored in verdicts."""

from __future__ import annotations

from collections.abc import Sequence

from mavhums.core.conditions import Condition
from mavhums.health.decision import FALSE_ALARMS
from mavhums.health.equations import own_current
from mavhums.health.own.cause import constant_lost
from mavhums.health.own.equation import OwnEquation
from mavhums.health.own.judge import Comparison, compare
from mavhums.health.own.motor import MOTOR_FAULTS, motor_indicators, motor_of
from mavhums.health.own.past import PastRecord, record_of
from mavhums.health.own.registry import EQUATIONS
from mavhums.health.own.stall import STALL_SHARES, stall_indicators
from mavhums.health.own.words import remedy_of, told, told_of_constant
from mavhums.report.assessment import (
    Evidence,
    Indicator,
    Interval,
    OwnRecord,
    Suspect,
    Verdict,
)

__all__ = ["held_against", "without_own"]

_OPEN: tuple[Condition, ...] = ("undecided", "learning", "unchanged", "changed")
_SURE = 0.999
_CONSTANT = "torque_constant"
_OF_THE_MOTOR = (*MOTOR_FAULTS, *STALL_SHARES)
_MAGNETS = "inspect the motor's magnets, which age and suffer from heat"


def held_against(verdict: Verdict, past: Sequence[PastRecord], false_alarms: float = FALSE_ALARMS) -> Verdict:
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
    told_by = _deciding(verdict)
    if told_by is None or verdict.condition not in _OPEN or verdict.worst not in _OPEN:
        return verdict
    equation, record = told_by
    found = compare(equation, record, past, false_alarms)
    lost = constant_lost(found, verdict.own, past) if found.condition == "changed" else None
    fault = equation.fault if lost is None else _CONSTANT
    text = told(equation, found) if lost is None else told_of_constant(equation, found, lost)
    replaced = (equation.fault, *_OF_THE_MOTOR)
    indicators = [shown for shown in verdict.indicators if shown.fault not in replaced]
    evidence = [known for known in verdict.evidence if known.kind != _kind(equation)]
    suspects = [suspect for suspect in verdict.suspects if suspect.fault not in (equation.fault, _CONSTANT)]
    if found.value is not None:
        indicators.append(_indicator(equation, record, found, found.value))
        evidence.append(_evidence(equation, record, found, found.value, text))
    current = found.value if equation == own_current.EQUATION else None
    indicators.extend(motor_indicators(verdict.own, past))
    indicators.extend(stall_indicators(verdict.own, motor_of(verdict.own), current))
    if found.condition == "changed":
        suspects.append(Suspect(fault=fault, confidence=_SURE))
    return verdict.model_copy(
        update={
            "condition": found.condition,
            "worst": found.condition,
            "suspects": tuple(suspects),
            "evidence": tuple(evidence),
            "indicators": tuple(indicators),
            "reason": text,
            "remedy": remedy_of(equation, found) if lost is None else _MAGNETS,
        }
    )


def without_own(verdict: Verdict) -> Verdict:
    """Return a verdict without the indicators and the evidence of own-scale equations."""
    faults = {*(equation.fault for equation in EQUATIONS), *_OF_THE_MOTOR}
    kinds = {_kind(equation) for equation in EQUATIONS}
    return verdict.model_copy(
        update={
            "indicators": tuple(shown for shown in verdict.indicators if shown.fault not in faults),
            "evidence": tuple(known for known in verdict.evidence if known.kind not in kinds),
        }
    )


def _deciding(verdict: Verdict) -> tuple[OwnEquation, OwnRecord] | None:
    """Return the most informative equation for this flight."""
    for equation in EQUATIONS:
        record = record_of(verdict.own, equation.name)
        if record is not None:
            return equation, record
    return None


def _kind(equation: OwnEquation) -> str:
    return f"{equation.fault}_own"


def _indicator(equation: OwnEquation, record: OwnRecord, found: Comparison, value: Interval) -> Indicator:
    windows = len(record.groups)
    error = (value.high - value.low) / 4.0
    return Indicator(
        fault=equation.fault,
        quantity=equation.quantity,
        unit=equation.unit,
        value=_rounded(value),
        windows=windows,
        scatter=float(f"{error * windows**0.5:.4g}"),
        baseline=found.baseline and _rounded(found.baseline),
        baseline_flights=found.flights,
        needed_flights=found.needed,
        least_rise=None if found.least_rise is None else round(found.least_rise, 4),
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


def _rounded(interval: Interval) -> Interval:
    return Interval(**{name: float(f"{number:.5g}") for name, number in interval})
