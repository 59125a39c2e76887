"""Compares a flight that was judged alone with the aircraft's earlier flights.

An actuator's comparison is a fold over the engine's events: windows and decisions in the order of time, for
the drift test of :mod:`mavhums.health.decision.baseline`. They come from the engine while it judges, or from
the record of the flight: a link, one command after each landing, a fleet, and a flight that arrives late give
the same result.
"""

from __future__ import annotations

import zlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from datetime import datetime
from functools import cache
from typing import Any, NamedTuple

from pydantic import TypeAdapter, ValidationError

from mavhums.actuator.mapping import AirframeNamed
from mavhums.core.conditions import Condition
from mavhums.core.errors import MavhumsError
from mavhums.engine.engine import Engine
from mavhums.engine.events import Event, StandaloneAssessment
from mavhums.health.axis.past import compare_response, compare_with_earlier_flights
from mavhums.health.decision.baseline import (
    Baseline,
    BaselineSource,
    Drift,
    PastSource,
    Shift,
    condition_with_drift,
    of_subject,
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
from mavhums.health.self_baseline.verdict import compare_with_own_flights, without_own
from mavhums.health.verdict import with_advice
from mavhums.health.verdict.actuator import BaselineFindings, against_baseline, with_refused
from mavhums.health.verdict.motor import compare_motors
from mavhums.results.assessment import Assessment
from mavhums.results.sections import NOT_COMPARED
from mavhums.results.verdict import Evidence, Suspect, Verdict

_LARGEST = 256 << 20


def compared(
    flight: StandaloneAssessment, baselines: BaselineSource, past: PastSource | None = None
) -> Assessment:
    """Return the assessment of a flight, compared with the actuators' own earlier flights.

    Parameters
    ----------
    flight
        The flight, judged alone.
    baselines
        Function that returns the baselines from the earlier flights for an airframe and a time.
    past
        Function that returns the earlier flights for an airframe and a time; None for none.
    """
    start = _start_of(flight.assessment)
    if start is None:
        return _not_compared(flight.assessment)
    comparisons, source = {}, cache(baselines)
    for key, record in flight.records.items():
        own = of_subject(source(flight.profiles.get(key, ""), start), key)
        if own:
            comparisons[key] = ActuatorComparison(own, record.false_alarms)
            for event in events_of(record, *key):
                comparisons[key].take(event)
    return _with_findings(flight, start, source, past, comparisons)


class FlightComparison:
    """Compares a flight with the actuators' own earlier flights while the engine judges it.

    It stands in for the engine. The events of an actuator that has a baseline are those of the comparison. A
    flight whose start is not known has no earlier flights.

    Parameters
    ----------
    engine
        A new engine.
    baselines, past
        As for :func:`compared`. Those of an airframe are looked up until there are some: a link's aircraft
        may become known in flight.

    Examples
    --------
    >>> comparison = FlightComparison(Engine(), lambda airframe, start: {})
    >>> comparison.feed(b"") + comparison.finish()
    []
    """

    def __init__(self, engine: Engine, baselines: BaselineSource, past: PastSource | None = None) -> None:
        self._engine, self._false_alarms = engine, engine.options.false_alarms
        self._past = _looked_up_once(past) if past else None
        self._baselines = _looked_up_once(baselines)
        self._airframes: dict[int | None, str] = {}
        self._comparisons: dict[tuple[int, str], ActuatorComparison | None] = {}

    def feed(self, block: bytes) -> list[Event]:
        """Take the next bytes and return the events that they cause."""
        return list(self.follow(self._engine.feed(block)))

    def finish(self) -> list[Event]:
        """End the input; judge the remaining data and return the events."""
        return list(self.follow(self._engine.finish()))

    def assessment(
        self, path: str | None = None, sha256: str | None = None, *, indicators: bool = True
    ) -> Assessment:
        """Return the verdicts on all data so far; ``indicators`` as in the engine."""
        alone = self._engine.assessment(path, sha256, indicators=indicators)
        start = _start_of(alone)
        if start is None:
            return _not_compared(alone)
        comparisons = {key: one for key, one in self._comparisons.items() if one}
        records = self._engine.records(whole=False) if comparisons else {}
        flight = StandaloneAssessment(alone, records, self._engine.profiles(), self._false_alarms)
        return _with_findings(flight, start, self._baselines, self._past, comparisons)

    def follow(self, events: Iterable[Event]) -> Iterator[Event]:
        """Yield the events of a flight after the comparison, given those of the flight alone."""
        for event in events:
            if isinstance(event, AirframeNamed):
                # What was judged by another profile does not count.
                self._airframes[event.vehicle] = event.airframe.name
                for key in [key for key in self._comparisons if key[0] == event.vehicle]:
                    del self._comparisons[key]
            if isinstance(event, ComparisonInput | Window | ConditionChanged | Forgotten):
                key = event.vehicle, event.actuator
                if isinstance(event, ComparisonInput) and key not in self._comparisons:
                    self._comparisons[key] = self._begun(key)
                one = self._comparisons.get(key)
                if one is not None:
                    yield from one.follow(event)
                elif isinstance(event, Window | ConditionChanged):
                    yield event
                if isinstance(event, Forgotten):
                    self._comparisons.pop(key, None)
            else:
                yield event

    def _begun(self, key: tuple[int, str]) -> ActuatorComparison | None:
        airframe = self._airframes.get(key[0], self._airframes.get(None))
        start = self._engine.start_utc()
        own = {} if start is None else of_subject(self._baselines(airframe, start), key)
        return ActuatorComparison(own, self._false_alarms) if own else None


def _with_findings(
    flight: StandaloneAssessment,
    start: datetime,
    baselines: BaselineSource,
    past: PastSource | None,
    comparisons: Mapping[tuple[int, str], ActuatorComparison],
) -> Assessment:
    """Return the assessment of a flight with what the comparisons found."""
    judged_by, end_s = flight.assessment.airframe, flight.assessment.log.duration_s
    known = baselines(judged_by, start)
    alone = flight.assessment.verdicts
    own_scale = any(verdict.own for verdict in alone if verdict.subject == "actuator")
    profiles = set(flight.profiles.values())
    flown = {name: past(name, start) for name in profiles} if past and own_scale else {}
    responses = any(verdict.own for verdict in alone if verdict.subject == "axis")
    before = past(judged_by, start) if past and responses else {}

    def found(verdict: Verdict) -> Verdict:
        if verdict.vehicle is None:
            return verdict
        key = (verdict.vehicle, verdict.actuator)
        if verdict.subject == "axis":
            own = of_subject(known, key)
            verdict = compare_with_earlier_flights(
                verdict, own, start_utc=start, end_s=end_s, false_alarms=flight.false_alarms
            )
            others = [
                one
                for one in alone
                if one.subject == "axis" and one.vehicle == key[0] and one.actuator != key[1]
            ]
            records = [each.records for each in before.get(key, ()) if each.healthy]
            return compare_response(
                verdict, records, others=others, start_utc=start, false_alarms=flight.false_alarms
            )
        if verdict.subject == "motor" or not verdict.coverage.windows:
            return verdict
        if key in comparisons:
            shown = comparisons[key].findings(flight.records[key])
            verdict = against_baseline(without_own(verdict), shown, start_utc=start, end_s=end_s)
        flights = flown.get(flight.profiles.get(key, ""), {}).get(key, ())
        return with_refused(compare_with_own_flights(verdict, flights, flight.false_alarms))

    verdicts = compare_motors(
        [found(verdict) for verdict in flight.assessment.verdicts],
        lambda verdict: of_subject(known, (verdict.vehicle or 0, verdict.actuator)),
        start_utc=start,
        end_s=end_s,
    )
    both = zip(alone, verdicts, strict=True)
    advised = tuple(one if now is one else with_advice(now) for one, now in both)
    return flight.assessment.model_copy(update={"verdicts": advised})


def _not_compared(assessment: Assessment) -> Assessment:
    """Return an assessment that says why earlier flights do not count: which are earlier is not known."""
    said = f"{NOT_COMPARED}: the log has no date (no satellite fix, no clock that was set, no file)"
    return assessment.with_notice(said)


def _start_of(assessment: Assessment) -> datetime | None:
    start = assessment.log.start_utc
    return None if start is None else datetime.fromisoformat(start)


def _looked_up_once(source: Callable[..., Mapping[Any, Any]]) -> Callable[..., Any]:
    known: dict[object, Mapping[Any, Any]] = {}

    def look_up(*wanted: object) -> Mapping[Any, Any]:
        if not known.get(wanted):
            known[wanted] = source(*wanted)
        return known[wanted]

    return look_up


def packed(flight: StandaloneAssessment) -> bytes:
    """Return a flight as bytes that :func:`unpacked` reads; the numbers are preserved exactly.

    Examples
    --------
    >>> import mavhums
    >>> from mavhums.app.analysis import analyse_alone
    >>> flight = analyse_alone("flight.tlog", mavhums.Options().resolved())
    >>> unpacked(packed(flight)) == flight
    True
    """
    content = _StoredFlight(
        flight.assessment,
        tuple((*key, flight.profiles[key], record) for key, record in flight.records.items()),
        flight.false_alarms,
    )
    return zlib.compress(_STORED.dump_json(content, by_alias=True))


def unpacked(data: bytes) -> StandaloneAssessment:
    """Return the flight in the bytes that :func:`packed` returned.

    Raises
    ------
    MavhumsError
        If the bytes are damaged, or from another version.
    """
    try:
        inflate = zlib.decompressobj()
        text = inflate.decompress(data, _LARGEST)
        content: Any = _STORED.validate_json(text)
    except (zlib.error, ValidationError) as error:
        raise MavhumsError(
            "a stored flight is damaged or of another version", "scan its log again"
        ) from error
    records = {(vehicle, actuator): record for vehicle, actuator, _, record in content.records}
    profiles = {(vehicle, actuator): profile for vehicle, actuator, profile, _ in content.records}
    return StandaloneAssessment(content.assessment, records, profiles, content.false_alarms)


class _StoredFlight(NamedTuple):
    assessment: Assessment
    records: tuple[tuple[int, str, str, ActuatorRecord], ...]
    false_alarms: float = FALSE_ALARMS


_STORED = TypeAdapter(_StoredFlight)


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
