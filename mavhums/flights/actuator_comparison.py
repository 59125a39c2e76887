"""The comparison of one actuator with its own baselines: a fold over the events of a flight judged alone."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import replace

from mavhums.core.conditions import Condition
from mavhums.engine.events import Event
from mavhums.health.decision.baseline import (
    Baseline,
    Drift,
    Shift,
    condition_with_drift,
    onset_with_drift,
)
from mavhums.health.decision.conditions import ConditionTracker, IndicatorChange
from mavhums.health.decision.events import (
    ActuatorRecord,
    ComparisonInput,
    ConditionChanged,
    Estimate,
    FaultRecord,
    Forgotten,
    IndicatorStep,
    Window,
)
from mavhums.health.decision.evidence import (
    concludes,
    drift_evidence,
    drift_rule,
    in_order,
    limit_rule,
    ranked,
    suspected,
)
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.health.verdict.actuator import BaselineFindings
from mavhums.results.verdict import Evidence, Suspect


class ActuatorComparison:
    """Compares one actuator with its own baselines: a fold over the events of a flight alone.

    Parameters
    ----------
    baselines
        Baselines from the actuator's earlier flights, by fault.
    false_alarms
        Alarms per 100 hours.
    """

    def __init__(self, baselines: Mapping[str, Baseline], false_alarms: float = FALSE_ALARMS) -> None:
        self._baselines, self._false_alarms = baselines, false_alarms
        self._traces: dict[str, IndicatorComparison] = {}
        self._held = ConditionTracker()
        self._changes: list[ConditionChanged] = []

    def follow(self, event: Event) -> Iterator[Event]:
        """Yield what an event of the flight alone becomes; its own changes of condition do not count."""
        if isinstance(event, ComparisonInput):
            self._changes = self.take(event)
        elif isinstance(event, Window):
            yield replace(event, condition=self._held.condition)
        elif isinstance(event, Forgotten):
            before, at_s = self._held.condition, event.time_s
            if before != "undecided":
                why = event.rule
                yield ConditionChanged(event.vehicle, event.actuator, at_s, at_s, before, "undecided", why)
        elif not isinstance(event, ConditionChanged):
            yield event
        # A change follows the window that causes it; the whole flight has none.
        if isinstance(event, Window) or (isinstance(event, ComparisonInput) and event.whole):
            yield from self._changes
            self._changes = []

    def take(self, event: ComparisonInput) -> list[ConditionChanged]:
        """Process a window, or the whole flight; return the changes of the actuator's condition."""
        turns = []
        for step in event.steps:
            fault = step.indicator.fault
            if fault not in self._traces:
                self._traces[fault] = IndicatorComparison(
                    step.indicator, self._baselines.get(fault), self._false_alarms
                )
            change = self._traces[fault].take(step, event)
            turn = self._held.take(fault, change) if change else None
            if turn is not None:
                turns.append(ConditionChanged(event.vehicle, event.actuator, event.end_s, *turn))
        return turns

    def findings(self, record: ActuatorRecord) -> BaselineFindings:
        """Return the findings so far, given the record so far."""
        evidence: list[Evidence] = []
        suspects: list[Suspect] = []
        decidable = 0
        for fault in record.faults:
            evidence += fault.evidence
            trace = self._traces.get(fault.fault)
            if trace is None:
                continue
            evidence += trace.evidence()
            suspects += trace.suspects(fault.latest)
            decidable = max(decidable, trace.windows if trace.alarm else 0)
        return BaselineFindings(
            condition=self._held.condition,
            worst=self._held.worst,
            since_s=self._held.since_s,
            suspects=ranked(suspects),
            evidence=in_order(evidence),
            baselines={fault: baseline.prediction() for fault, baseline in self._baselines.items()},
            last_s=record.end_s,
            decidable=decidable,
        )


class IndicatorComparison:
    """Tracks one indicator through a flight."""

    def __init__(self, indicator: FaultRecord, baseline: Baseline | None, false_alarms: float) -> None:
        self.windows = 0
        self._indicator, self._false_alarms = indicator, false_alarms
        self._drift = (
            Drift(baseline, two_sided=indicator.two_sided, false_alarms=false_alarms) if baseline else None
        )
        self._decided: Condition = "undecided"
        self._decided_s: float | None = None
        self._whole: Estimate | None = None
        self._last_s = 0.0

    def take(self, step: IndicatorStep, event: ComparisonInput) -> IndicatorChange | None:
        """Process a step of a window or of the whole flight; return the change of the condition."""
        before, change = self.condition, step.change
        if step.estimate is not None and event.whole:
            self._whole = step.estimate
            if self._drift is not None:
                self._drift.conclude(*step.estimate, event.start_s)
        elif step.estimate is not None:
            self.windows, self._last_s = self.windows + 1, event.end_s
            if self._drift is not None:
                self._drift.feed(*step.estimate, event.start_s)
        if change is not None:
            self._decided, self._decided_s = change.condition, change.since_s
        if self.condition == before:
            return None
        since_s = onset_with_drift(self._decided, self._decided_s, self.alarm) or 0.0
        rule = change.rule if change is not None else ""
        # What the limits did not decide, the shift from the baseline did.
        if self._drift and self.alarm and (change is None or self.condition != change.condition):
            rule = drift_rule(self._indicator, self._drift.baseline, self.alarm, self._false_alarms)
            rule += ", over the whole flight" if event.whole else ""
        return IndicatorChange(self.condition, event.start_s if event.whole else since_s, rule)

    def suspects(self, latest: Estimate | None) -> Iterator[Suspect]:
        """Yield the suspected fault, if there is one; ``latest`` is the latest estimate."""
        found = suspected(self._indicator, self._decided, latest or self._whole, self.alarm)
        if found is not None:
            yield found

    def evidence(self) -> Iterator[Evidence]:
        """Yield the shift from the baseline, if it alarmed."""
        if self._drift and self.alarm:
            baseline, end_s = self._drift.baseline, self._last_s
            yield drift_evidence(self._indicator, baseline, self.alarm, end_s, self._false_alarms)

    @property
    def alarm(self) -> Shift | None:
        """The shift from the baseline, if it alarmed."""
        return self._drift.alarm if self._drift else None

    @property
    def condition(self) -> Condition:
        """Condition according to the limits, or at least degraded after a shift from the baseline."""
        return condition_with_drift(self._decided, self.alarm)


def events_of(record: ActuatorRecord, vehicle: int, actuator: str) -> Iterator[ComparisonInput]:
    """Yield the events that a record has kept, in the order of time, then of the detectors, as in flight."""
    steps: dict[float, dict[str, IndicatorStep]] = defaultdict(dict)
    for fault in record.faults:
        for end_s, *window in fault.windows:
            steps[end_s][fault.fault] = IndicatorStep(fault, Estimate(*window), None)
        for end_s, condition, since_s in fault.decided:
            change = IndicatorChange(condition, since_s, limit_rule(fault, condition, record.false_alarms))
            known = steps[end_s].get(fault.fault, IndicatorStep(fault, None, None))
            steps[end_s][fault.fault] = known._replace(change=change)
    for end_s in sorted(steps):
        start_s = end_s - WINDOW_S
        yield ComparisonInput(vehicle, actuator, start_s, end_s, tuple(steps[end_s].values()))
    if record.concluded_s is None:
        return
    judged = next((len(fault.windows) for fault in record.faults if fault.fault == "friction"), 0)
    whole = []
    for fault in record.faults:
        settled = fault.settled
        if settled is not None or concludes(len(fault.windows), judged):
            rule = limit_rule(fault, settled, record.false_alarms) if settled else ""
            by_flight = IndicatorChange(settled, record.concluded_s, rule) if settled else None
            whole.append(IndicatorStep(fault, fault.whole, by_flight))
    yield ComparisonInput(vehicle, actuator, record.concluded_s, record.end_s, tuple(whole), whole=True)
