"""Compares an actuator's indicators with its earlier flights: a pure function of stored numbers.

Each indicator over the whole flight is compared with the same one over the earlier healthy flights. It counts
if the difference is certain, given its errors and the scatter between flights: wear from the start on.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime

import numpy as np

from mavhums.core.conditions import SEVERITY
from mavhums.core.statistics import t_quantile
from mavhums.health.actuator.detectors import DETECTORS
from mavhums.health.decision.baseline import Baseline, ComparedIndicator, with_baselines
from mavhums.health.decision.conditions import since
from mavhums.health.decision.evidence import (
    Departure,
    alarms_in_words,
    confidence_of,
    in_unit,
    with_departures,
)
from mavhums.health.decision.limits import tail_of_flight
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.results.reasons import said
from mavhums.results.verdict import DRIFT, Verdict

_TWO_SIDED = {each.fault for each in DETECTORS if each.two_sided}


def compare_with_earlier_flights(
    verdict: Verdict,
    baselines: Mapping[str, Baseline],
    *,
    start_utc: datetime,
    end_s: float,
    false_alarms: float = FALSE_ALARMS,
) -> Verdict:
    """Return the verdict on an actuator after the comparison with its earlier flights.

    Parameters
    ----------
    verdict
        Verdict on the flight alone.
    baselines
        Baselines of the actuator's indicators, by fault.
    start_utc, end_s
        Start of flight time, and the end of the log in flight time.
    false_alarms
        Allowed false alarms per 100 hours of an indicator.
    """
    verdict = with_baselines(verdict, baselines)
    found = [*_departures(verdict, baselines, false_alarms)]
    if not found:
        return verdict
    shown = {one.fault: one.windows for one in verdict.indicators}
    decidable = max(verdict.coverage.decidable, *(shown[one.fault] for one in found))
    changes: dict[str, object] = {"coverage": verdict.coverage.model_copy(update={"decidable": decidable})}
    # Silence is never a condition, and a limit that decided keeps its onset.
    if "silent" not in verdict.reason_codes and SEVERITY[verdict.condition] < SEVERITY["degraded"]:
        changes |= {"condition": "degraded", "since": since(0.0, start_utc), **said()}
    return with_departures(verdict, found, (0.0, end_s), "over the whole flight", changes=changes)


def _departures(
    verdict: Verdict, baselines: Mapping[str, Baseline], false_alarms: float
) -> Iterator[Departure]:
    """Yield the indicators that certainly differ from their baselines."""
    # On a held shaft no balance of torques or angles is valid.
    if any(item.kind == "jam" for item in verdict.evidence):
        return
    by_network = verdict.network is not None and verdict.network.decides == "network"
    compared = [
        ComparedIndicator.of(shown, baselines[shown.fault])
        for shown in verdict.indicators
        # What a network decides the physics does not overrule.
        if shown.fault in baselines and not (by_network and shown.fault == "friction")
    ]
    tail = tail_of_flight(false_alarms, verdict.coverage.windows)
    two_sided = np.array([one.indicator.fault in _TWO_SIDED for one in compared])
    ratios = np.array([one.ratio for one in compared])
    bounds = t_quantile(np.array([one.freedom for one in compared]), 1.0 - tail / (1 + two_sided))
    certain = np.where(two_sided, np.abs(ratios), ratios) > bounds
    found = [one for one, is_certain in zip(compared, certain, strict=True) if is_certain]
    for one in sorted(found, key=lambda one: -abs(one.ratio)):  # the clearest cause comes first
        shown, known = one.indicator, one.baseline
        rule = (
            f"degraded: {shown.quantity} {in_unit(one.difference, shown.unit, '+')} from its own baseline of "
            f"{in_unit(known.mean, shown.unit)} over {known.flights} flights, "
            f"with {alarms_in_words(false_alarms)}"
        )
        yield Departure(
            shown.fault,
            "degraded",
            shown.compared[0],
            known.mean,
            rule,
            confidence_of(one),
            kind=f"{shown.fault}{DRIFT}",
        )
