"""Compares a flight that was judged alone with the aircraft's earlier flights.

An actuator's comparison is a fold over what its record has kept: windows and decisions in the order of time.
It feeds the drift test of :mod:`mavhums.health.decision.baseline` as a flight does. It is a pure function:
one command after each landing, a fleet, and a flight that arrives late give the same result.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from datetime import datetime
from itertools import groupby
from typing import Any, NamedTuple

from pydantic import TypeAdapter, ValidationError

from mavhums.core.conditions import Condition
from mavhums.core.errors import MavhumsError
from mavhums.health.axis.past import compare_with_earlier_flights
from mavhums.health.decision.baseline import (
    Baseline,
    BaselineSource,
    Drift,
    Shift,
    condition_with_drift,
    of_subject,
    onset_with_drift,
)
from mavhums.health.decision.conditions import ConditionTracker, IndicatorChange
from mavhums.health.decision.evidence import (
    concludes,
    drift_evidence,
    drift_rule,
    in_order,
    limit_rule,
    ranked,
    suspected,
)
from mavhums.health.decision.records import ActuatorRecord, FaultRecord
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.health.self_baseline.past import PastSource
from mavhums.health.self_baseline.verdict import compare_with_own_flights, without_own
from mavhums.health.verdict.actuator import BaselineFindings, against_baseline
from mavhums.health.verdict.advice import with_advice
from mavhums.report.assessment import Assessment, Evidence, Suspect, Verdict

__all__ = ["LoneFlight", "Records", "against_baselines", "compared", "packed", "unpacked"]

Records = Mapping[tuple[int, str], ActuatorRecord]
"""What a flight leaves of each actuator, by vehicle and actuator."""

_LARGEST = 256 << 20


class LoneFlight(NamedTuple):
    """A flight judged by itself.

    Attributes
    ----------
    assessment
        The assessment without any baseline.
    records
        Records of the actuators, by vehicle and actuator.
    profiles
        Name of the profile by which each actuator was judged.
    false_alarms
        Accepted number of false alarms in 100 hours of an actuator or an axis.
    """

    assessment: Assessment
    records: Records
    profiles: Mapping[tuple[int, str], str]
    false_alarms: float = FALSE_ALARMS


def compared(flight: LoneFlight, baselines: BaselineSource, past: PastSource | None = None) -> Assessment:
    """Return the assessment of a flight, compared with the actuators' own earlier flights.

    Parameters
    ----------
    flight
        The flight, judged alone.
    baselines
        Baselines from the earlier flights, or a function that returns them for an airframe and a time.
    past
        Function that returns the earlier flights for an airframe and a time; None for none.
    """
    log = flight.assessment.log
    start = None if log.start_utc is None else datetime.fromisoformat(log.start_utc)
    if start is None:
        return flight.assessment
    profiles = set(flight.profiles.values())
    judged_by = flight.assessment.airframe
    known = {
        name: baselines(name, start) if callable(baselines) else baselines for name in {*profiles, judged_by}
    }
    own_scale = any(verdict.own for verdict in flight.assessment.verdicts)
    flown = {name: past(name, start) for name in profiles} if past and own_scale else {}

    def held(verdict: Verdict) -> Verdict:
        key = (verdict.vehicle or 0, verdict.actuator)
        record, profile = flight.records.get(key), flight.profiles.get(key, "")
        if verdict.subject == "axis":
            own = of_subject(known[judged_by], key)
            return compare_with_earlier_flights(
                verdict, own, start_utc=start, end_s=log.duration_s, false_alarms=flight.false_alarms
            )
        if record is None or not verdict.coverage.windows:
            return verdict
        own = of_subject(known.get(profile, {}), key)
        if own:
            alone = without_own(verdict)
            verdict = against_baselines(alone, record, own, start_utc=start, end_s=log.duration_s)
        return compare_with_own_flights(verdict, flown.get(profile, {}).get(key, ()), record.false_alarms)

    return flight.assessment.model_copy(
        update={"verdicts": tuple(with_advice(held(verdict)) for verdict in flight.assessment.verdicts)}
    )


def against_baselines(
    verdict: Verdict,
    record: ActuatorRecord,
    baselines: Mapping[str, Baseline],
    *,
    start_utc: datetime,
    end_s: float,
) -> Verdict:
    """Return the verdict on an actuator after the comparison with its own baseline.

    Parameters
    ----------
    verdict
        Verdict on the flight alone.
    record
        Record of the same flight.
    baselines
        Baselines from the actuator's earlier flights, by fault.
    start_utc
        Start of flight time.
    end_s
        End of the log, in flight time.
    """
    traces = [_Trace(record, fault, baselines.get(fault.fault)) for fault in record.faults]
    # In the order of time, then of the detectors, as in flight.
    changes = [(at_s, place, said) for place, trace in enumerate(traces) for at_s, said in trace.changes()]
    holding = ConditionTracker()
    for _, place, said in sorted(changes, key=lambda each: each[:2]):
        holding.take(record.faults[place].fault, said)
    if record.concluded_s is not None:
        judged = next((len(fault.windows) for fault in record.faults if fault.fault == "friction"), 0)
        concluded = [
            (trace.fault.fault, trace.conclude(record.concluded_s))
            for trace in traces
            if concludes(len(trace.fault.windows), judged) or trace.fault.settled is not None
        ]
        for fault, change in concluded:
            if change is not None:
                holding.take(fault, change)
    evidence = (each for trace in traces for each in trace.evidence())
    intervals = {fault: baseline.prediction() for fault, baseline in baselines.items()}
    return against_baseline(
        verdict,
        BaselineFindings(
            condition=holding.condition,
            worst=holding.worst,
            since_s=holding.since_s,
            suspects=ranked(suspect for trace in traces if (suspect := trace.suspect())),
            evidence=in_order(evidence),
            baselines=intervals,
            last_s=record.end_s,
            decidable=max([0, *(len(trace.fault.windows) for trace in traces if trace.alarm)]),
        ),
        start_utc=start_utc,
        end_s=end_s,
    )


class _RecordedStep(NamedTuple):
    """The events at the end of a window: a non-overlapping window, then a decision."""

    end_s: float
    order: int
    place: int


class _Trace:
    """Tracks one indicator through the record of a flight, as the tracker does in flight."""

    def __init__(self, record: ActuatorRecord, fault: FaultRecord, baseline: Baseline | None) -> None:
        self.record = record
        self.fault = fault
        self.drift = (
            Drift(baseline, two_sided=fault.two_sided, false_alarms=record.false_alarms) if baseline else None
        )
        self._decided: Condition = "undecided"
        self._decided_s: float | None = None
        self._latest = fault.latest

    def changes(self) -> Iterator[tuple[float, IndicatorChange]]:
        """Yield each change of the condition, with the end of the window that causes it."""
        events = [_RecordedStep(window.end_s, 0, k) for k, window in enumerate(self.fault.windows)]
        events += [_RecordedStep(decided.end_s, 1, k) for k, decided in enumerate(self.fault.decided)]
        for end_s, together in groupby(sorted(events), key=lambda event: event.end_s):
            before = self._condition
            for event in together:
                self._take(event)
            if self._condition != before:
                since_s = onset_with_drift(self._decided, self._decided_s, self.alarm)
                yield end_s, IndicatorChange(0, self._condition, since_s or 0.0, self._rule())

    def conclude(self, start_s: float) -> IndicatorChange | None:
        """Judge by the whole flight, which counts from ``start_s``; return the change."""
        before, whole = self._condition, self.fault.whole
        if self.drift is not None and whole is not None:
            self.drift.conclude(*whole, start_s)
            self._latest = self._latest or whole
        if self.fault.settled is not None:
            self._decided, self._decided_s = self.fault.settled, start_s
        if self._condition == before:
            return None
        return IndicatorChange(0, self._condition, start_s, f"{self._rule()}, over the whole flight")

    def suspect(self) -> Suspect | None:
        """Return the suspected fault, if there is one."""
        return suspected(self.fault, self._decided, self._latest, self.alarm)

    def evidence(self) -> Iterator[Evidence]:
        """Yield the evidence according to the limits, and the shift from the baseline if it alarmed."""
        yield from self.fault.evidence
        if self.drift is not None and self.alarm is not None:
            windows, length_s = self.fault.windows, self.record.window_s
            last_s = windows[-1].end_s + length_s - length_s if windows else self.alarm.since_s
            yield drift_evidence(
                self.fault, self.drift.baseline, self.alarm, last_s, self.record.false_alarms
            )

    @property
    def alarm(self) -> Shift | None:
        """The shift from the baseline, if it alarmed."""
        return self.drift.alarm if self.drift else None

    @property
    def _condition(self) -> Condition:
        return condition_with_drift(self._decided, self.alarm)

    def _take(self, event: _RecordedStep) -> None:
        if event.order:
            _, self._decided, self._decided_s = self.fault.decided[event.place]
        elif self.drift is not None:
            window = self.fault.windows[event.place]
            start_s = window.end_s - self.record.window_s
            self.drift.feed(window.value, window.error, window.freedom, start_s)

    def _rule(self) -> str:
        """Return the reason for the condition as text."""
        condition, alarms = self._condition, self.record.false_alarms
        if condition != self._decided and self.drift is not None and self.alarm is not None:
            return drift_rule(self.fault, self.drift.baseline, self.alarm, alarms)
        return limit_rule(self.fault, condition, alarms)


def packed(flight: LoneFlight) -> bytes:
    """Return a flight as bytes that :func:`unpacked` reads; the numbers are preserved exactly.

    Examples
    --------
    >>> import mavhums
    >>> from mavhums.app.analysis import analyse_alone
    >>> flight = analyse_alone("flight.tlog", mavhums.Options().resolved())
    >>> unpacked(packed(flight)) == flight
    True
    """
    content = _Stored(
        flight.assessment,
        tuple((*key, flight.profiles[key], record) for key, record in flight.records.items()),
        flight.false_alarms,
    )
    return zlib.compress(_STORED.dump_json(content, by_alias=True))


def unpacked(data: bytes) -> LoneFlight:
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
    return LoneFlight(content.assessment, records, profiles, content.false_alarms)


class _Stored(NamedTuple):
    assessment: Assessment
    records: tuple[tuple[int, str, str, ActuatorRecord], ...]
    false_alarms: float = FALSE_ALARMS


_STORED = TypeAdapter(_Stored)
