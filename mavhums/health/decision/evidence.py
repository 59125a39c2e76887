"""Words of a decision, and what a comparison with earlier flights adds to a verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import t_probability
from mavhums.health.decision.baseline import ComparedIndicator
from mavhums.health.decision.limits import MOST_CONFIDENCE
from mavhums.results.verdict import Evidence, Interval, Suspect, Verdict


def in_unit(value: float, unit: str, sign: str = "") -> str:
    """Return a value with its unit.

    Examples
    --------
    >>> in_unit(0.05, "N·m", "+"), in_unit(0.2, "1")
    ('+0.05 N·m', '0.2')
    """
    return f"{value:{sign}.3g}" if unit == "1" else f"{value:{sign}.3g} {unit}"


def alarms_in_words(false_alarms: float) -> str:
    """Return the accepted rate of false alarms."""
    return f"≤ {false_alarms:g} false alarm{'' if false_alarms == 1 else 's'} per 100 h"


@dataclass(frozen=True, slots=True)
class Departure:
    """A difference from the earlier flights that counts; the kind of its evidence is the fault if empty."""

    fault: str
    condition: Condition
    value: float
    limit: float
    rule: str
    confidence: float
    effectiveness: Interval | None = None
    kind: str = ""


def confidence_of(one: ComparedIndicator) -> float:
    """Return the confidence that a quantity differs from its baseline."""
    return round(min(t_probability(one.freedom, abs(one.ratio)), MOST_CONFIDENCE), 4)


def with_departures(
    verdict: Verdict,
    found: Sequence[Departure],
    span_s: tuple[float, float],
    when: str = "",
    *,
    changes: Mapping[str, object],
) -> Verdict:
    """Return a verdict with departures as evidence and suspects, the worst condition and other changes.

    Parameters
    ----------
    verdict, found
        The verdict, and at least one departure.
    span_s, when
        Flight times from and to which they hold, and the same in words where their rules do not say it.
    changes
        Further fields.
    """
    suspects = {one.fault: one.confidence for one in verdict.suspects}
    suspects |= {one.fault: max(one.confidence, suspects.get(one.fault, 0.0)) for one in found}
    evidence = [
        Evidence(
            kind=one.kind or one.fault,
            start_s=span_s[0],
            end_s=span_s[1],
            value=round(one.value, 4),
            limit=one.limit,
            rule=f"{one.rule}, {when}" if when else one.rule,
        )
        for one in found
    ]
    return verdict.model_copy(
        update={
            "worst": max(verdict.worst, *(one.condition for one in found), key=SEVERITY.__getitem__),
            "suspects": tuple(
                Suspect(fault=fault, confidence=confidence)
                for fault, confidence in sorted(suspects.items(), key=lambda each: -each[1])
            ),
            "evidence": tuple(sorted((*verdict.evidence, *evidence), key=lambda each: each.start_s)),
            **changes,
        }
    )
