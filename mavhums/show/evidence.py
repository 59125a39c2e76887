"""The evidence of a flight: what each subject shows of its curves, that which decided first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import starmap
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from mavhums.results.assessment import Assessment
from mavhums.results.sections import AxisLimits
from mavhums.results.verdict import ALL, Verdict
from mavhums.show.curves import Curve, CurveKey, EvidenceCollector
from mavhums.show.event_words import EVIDENCE, event_words, in_order, trace_words
from mavhums.show.verdict_words import windows_by_class
from mavhums.show.words import axis_levels, clock, levels, name, percent

_PLOTS = 24


class Limit(NamedTuple):
    """A level that a curve is compared with."""

    value: float
    name: str

    @property
    def label(self) -> str:
        """The word beside the curve, where there is room for one."""
        return self.name.split()[0]


class CaptionedCurve(NamedTuple):
    """A curve with its words.

    Attributes
    ----------
    vehicle
        The vehicle whose flight modes are below it.
    caption
        What the curve shows, for who does not see it.
    since_s
        Onset of what is wrong; None where nothing is.
    reference_s
        Seconds from and to which the reference was learned; None without one.
    modes, events
        Times and names of the flight modes of its vehicle, and of what else happened.
    """

    vehicle: int
    title: str
    caption: str
    curve: Curve
    limits: tuple[Limit, ...] = ()
    since_s: float | None = None
    reference_s: tuple[int, int] | None = None
    modes: Sequence[tuple[float, str]] = ()
    events: Sequence[tuple[float, str]] = ()


def evidence(assessment: Assessment, gathered: EvidenceCollector) -> Iterator[CaptionedCurve]:
    """Yield the curves: of what is faulty, the gravest first; then the evidence of the rest; then the others.

    The first one of each shows what decided.
    """
    ranked = sorted(_ranked(assessment, gathered), key=itemgetter(0))
    for _, curve in ranked[:_PLOTS]:
        own = [one for one in assessment.events if one.vehicle == curve.vehicle]
        modes = [(one.time_s, one.said or "") for one in own if one.kind == "mode"]
        events = [(one.time_s, event_words(one)) for one in own if one.kind != "mode"]
        yield curve._replace(modes=modes, events=events)


def _ranked(assessment: Assessment, gathered: EvidenceCollector) -> Iterator[tuple[int, CaptionedCurve]]:
    """Yield each curve with its rank."""
    curves, traces, networks = gathered.curves(), gathered.traces(), gathered.networks()
    for verdict in assessment.ranked():
        if verdict.vehicle is None or verdict.actuator == ALL:
            continue
        rest = 2 * (not verdict.suspects)
        since_s = verdict.since.flight_time_s if verdict.since and verdict.suspects else None
        reference_s = gathered.references_s.get((verdict.vehicle, verdict.actuator))
        for rank, captioned in _of_verdict(verdict, curves, traces, name(verdict, assessment)):
            yield min(rank, rest), captioned._replace(since_s=since_s, reference_s=reference_s)
        said = networks.get((verdict.vehicle, verdict.actuator))
        if said is not None:
            yield rest, _network(verdict, said, assessment)
    subjects = {(verdict.vehicle, verdict.actuator) for verdict in assessment.verdicts}
    several = len({verdict.vehicle for verdict in assessment.verdicts}) > 1
    for key, curve in traces.items():
        if key[:2] not in subjects:  # the frame, motors of a flight in which none is judged
            whose = f"{key.vehicle}: {key.actuator}" if several else key.actuator
            yield 1 + (key.fault != EVIDENCE), _trace(whose, key, curve)


def _of_verdict(
    verdict: Verdict, curves: Mapping[CurveKey, Curve], traces: Mapping[CurveKey, Curve], whose: str
) -> Iterator[tuple[int, CaptionedCurve]]:
    """Yield the curves of one subject, that which decided first."""
    assert verdict.vehicle is not None
    suspects = [item.fault for item in verdict.suspects]
    since_s = verdict.since.flight_time_s if verdict.since and suspects else np.inf
    kinds = [key.fault for key in traces if key[:2] == (verdict.vehicle, verdict.actuator)]
    banked = CurveKey(verdict.vehicle, "roll", "roll_angle")
    if "hard_over" in suspects and not kinds and banked in traces:
        # What no output explains is judged without a reference, and the bank shows it.
        yield 1, _trace(whose, banked, traces[banked], since_s)
    for kind in in_order(kinds, suspects[0] if suspects else ""):
        key = CurveKey(verdict.vehicle, verdict.actuator, kind)
        yield 1 + (kind != EVIDENCE), _trace(whose, key, traces[key], since_s)
    alarms = [item.fault for item in verdict.evidence]
    for fault in dict.fromkeys((*suspects, *alarms, "friction", "effectiveness")):
        curve = curves.get(CurveKey(verdict.vehicle, verdict.actuator, fault))
        if curve is None or not curve.time_s.size:
            continue
        what, limits = _limits(verdict, fault)
        last = curve.rows[-1]
        caption = (
            f"{what}: {last[1]:.3g} at the end (95 % interval {last[0]:.3g} to {last[2]:.3g}), "
            f"highest {curve.rows[:, 1].max():.3g}, lowest {curve.rows[:, 1].min():.3g}"
        )
        bounds = "; ".join(f"{limit.name} {limit.value:.3g}" for limit in limits)
        caption = f"{caption}; {bounds}" if bounds else caption
        yield 2, CaptionedCurve(verdict.vehicle, f"{whose}: {what}", caption, curve, limits)


def _trace(whose: str, key: CurveKey, curve: Curve, since_s: float = np.inf) -> CaptionedCurve:
    """Return what lies behind a judgement, and how it is read."""
    words, values, against = trace_words(key.actuator, key.fault), curve.rows[:, 1], curve.demanded
    assert against is not None
    title = f"{whose}: {words.quantity}"
    if key.fault == EVIDENCE:
        alarm, most = float(against[-1]), int(values.argmax())
        over = values >= alarm
        at = clock(float(curve.time_s[over.argmax() if over.any() else most]))
        caption = f"at most {values[most]:.1f}, at {at}: no alarm, which takes {alarm:.1f}"
        if over.any():
            caption = f"an alarm takes {alarm:.1f}, reached at {at}; drawn up to twice as much"
        limits = (Limit(alarm, "alarm above"),)
        return CaptionedCurve(key.vehicle, title, caption, curve._replace(demanded=None), limits)
    caption = f"solid: {words.value}; dashed: {words.against}"
    apart = np.where(curve.time_s >= since_s, np.abs(values - against), np.nan)
    if np.isfinite(apart).any():
        most = int(np.nanargmax(apart))
        caption += f"; farthest apart at {clock(float(curve.time_s[most]))}, by {apart[most]:.3g}"
    return CaptionedCurve(key.vehicle, title, caption, curve)


def _network(verdict: Verdict, said: Curve, assessment: Assessment) -> CaptionedCurve:
    """Return the network's answer over the flight, as the paper's figures 16 to 19 show it."""
    caption = "probability of a fault in ten seconds; thin: of an emergency by friction in each sample"
    network = verdict.network
    if network:
        caption += (
            f"; {windows_by_class(network)}; of the samples in motion within its training range it calls"
        )
        caption += f" {percent(network.share_of_samples)} an emergency"
    assert verdict.vehicle is not None
    title = f"{name(verdict, assessment)}: {network.model.name if network else 'the network'}"
    return CaptionedCurve(verdict.vehicle, title, caption, said, (Limit(0.5, "likelier a fault above"),))


def _limits(verdict: Verdict, fault: str) -> tuple[str, tuple[Limit, ...]]:
    """Return what a curve shows, with its unit, and the levels that it is compared with."""
    if fault == "effectiveness":
        what = "control effectiveness, share of the reference"
        return what, tuple(starmap(Limit, axis_levels(verdict.limits or AxisLimits())))
    found = next((item for item in verdict.indicators if item.fault == fault), None)
    if found is None:
        return fault.replace("_", " "), ()
    unit = "" if found.unit == "1" else f", {found.unit}"
    return f"{found.quantity}{unit}", tuple(starmap(Limit, levels(found.limit, found.emergency)))
