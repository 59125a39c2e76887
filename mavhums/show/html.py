"""The answer as one HTML page without scripts: for a browser without a network, for a phone, for paper."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import PurePath
from typing import NamedTuple

import numpy as np

from mavhums.core.about import __version__
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.report.assessment import ALL, Assessment, Verdict
from mavhums.report.sections import AxisLimits
from mavhums.show.digest import Subject, advice, digest
from mavhums.show.html_craft import FIXED_WING, DrawnSurface, multirotor, outline
from mavhums.show.html_curves import Curve, Gathered, Key
from mavhums.show.html_environment import ICONS, environment, moment
from mavhums.show.html_plot import Limit, Plot, plot
from mavhums.show.verdict_words import certainty, explanation, implausible
from mavhums.show.words import clock, finding, join, name, percent

__all__ = ["ICONS", "Brief", "in_brief", "page"]

_ROWS, _PLOTS, _FINDINGS, _LIKE = 200, 24, 8, 6
_VEHICLES, _OUTPUTS = 8, 32
_ATTITUDES = {"tracking": "", "hard_over": "roll"}
"""The axis whose demanded and flown angle show a fault; empty for the verdict's own."""


class _Answer(NamedTuple):
    """The five questions about one subject."""

    title: str
    verdict: Verdict
    past: str
    since: str
    why: Sequence[str]
    sure: str
    todo: str
    value: str


class _Shown(NamedTuple):
    """A plot with the words that describe it."""

    title: str
    told: str
    drawing: Plot


class _Aircraft(NamedTuple):
    """The outline of one vehicle."""

    title: str
    parts: list[DrawnSurface]
    body: Sequence[str]


class Brief(NamedTuple):
    """An assessment in a line: its gravest condition, the finding, and what to do."""

    condition: Condition
    headline: str
    todo: str


def in_brief(assessment: Assessment) -> Brief:
    """Return the assessment in a line.

    Examples
    --------
    >>> import mavhums
    >>> in_brief(mavhums.analyse("flight.tlog")).condition
    'emergency'
    """
    said = digest(assessment)
    first = _first([_answer(one) for one in said.subjects[:_ROWS]])
    return Brief(said.gravest, said.headline, first.todo if first else "")


def page(assessment: Assessment, gathered: Gathered) -> str:
    """Return the assessment as one HTML document, complete in itself.

    Texts from the log are escaped; control characters are replaced. The document carries no script, and its
    content security policy forbids any and every address.

    Parameters
    ----------
    assessment
        The verdicts of one log.
    gathered
        What the engine reported of the same log.

    Examples
    --------
    >>> import mavhums
    >>> text = page(mavhums.analyse("flight.tlog"), Gathered())
    >>> "<h1" in text, "<script" in text
    (True, False)
    """
    said = digest(assessment)
    rest, log = said.assessment, assessment.log
    answers = [_answer(one) for one in said.subjects[:_ROWS]]
    return (
        environment("mavhums.show")
        .get_template("report.html")
        .render(
            assessment=assessment,
            said=said,
            answers=answers,
            first=_first(answers),
            left_out=max(len(said.subjects) - _ROWS, 0),
            file=PurePath(log.path.replace("\\", "/")).name if log.path else "a live link",
            aircraft=list(_aircraft(rest)),
            plots=list(_plots(rest, gathered)),
            tables=[table._replace(rows=table.rows[:_OUTPUTS]) for table in said.tables[:_VEHICLES]],
            notices=gathered.notices(),
            texts=gathered.texts,
            version=__version__,
        )
    )


def _answer(one: Subject) -> _Answer:
    """Return the answer about one verdict, or about several that differ in nothing but the name."""
    verdict, value = one.verdict, ""
    since = verdict.since if SEVERITY[verdict.gravest] > SEVERITY["normal"] else None
    if one.control_left:
        value = f"{'thrust' if verdict.subject == 'motor' else 'control'} left: {one.control_left}"
    elif one.friction:
        value = f"friction {one.friction} N·m"
    return _Answer(
        title=one.title,
        verdict=verdict,
        past=one.past[1] if one.past else "",
        since=f"{clock(since.flight_time_s)} into the log ({moment(since.utc)})" if since else "",
        why=[*_why(one)],
        sure=certainty(verdict) if verdict.coverage.windows or verdict.evidence else "",
        todo=(verdict.remedy or advice(verdict)).rstrip("."),
        value=value,
    )


def _first(answers: Sequence[_Answer]) -> _Answer | None:
    """Return the answer that the page begins with: the gravest one, or several of like gravity as one."""
    like = [one for one in answers if one.verdict.gravest == answers[0].verdict.gravest]
    like = [one for one in like if not one.verdict.consequence_of] or like
    if len(like) < 2:
        return like[0] if like else None
    well = SEVERITY[like[0].verdict.gravest] == SEVERITY["normal"]
    why = [f"{one.title}: {one.value if well else (*one.why, one.value)[0]}" for one in like[:_LIKE]]
    more = [f"{len(like) - _LIKE} more below"] if len(like) > _LIKE else []
    return like[0]._replace(
        title=join([*(one.title for one in like[:_LIKE]), *more]),
        since=join(f"{one.title} {one.since}" for one in like[:_LIKE]) if like[0].since else "",
        why=why + more,
        sure="",
        todo="; ".join(dict.fromkeys(one.todo for one in like[:_LIKE])),
        value="",
    )


def _why(one: Subject) -> Iterator[str]:
    """Yield the reasons, the latest finding first, the network's vote after the physics."""
    verdict, past = one.verdict, one.past
    if past and past[1]:
        yield f"{past[0]} {past[1]}, then {verdict.condition}; the earlier finding stands"
    if verdict.reason:
        yield verdict.reason
    if explained := explanation(verdict):
        yield explained
    latest = sorted(verdict.evidence[-_FINDINGS:], key=lambda item: (item.kind == "network", -item.end_s))
    yield from (finding(item) for item in latest)
    if len(verdict.evidence) > _FINDINGS:
        yield f"{len(verdict.evidence) - _FINDINGS} earlier findings: mavhums analyse --json has them"
    odd = implausible(verdict)
    if odd:
        yield odd


def _aircraft(assessment: Assessment) -> Iterator[_Aircraft]:
    vehicles = dict.fromkeys(verdict.vehicle for verdict in assessment.verdicts)
    for vehicle in list(vehicles)[:_VEHICLES]:
        own = [verdict for verdict in assessment.verdicts if verdict.vehicle == vehicle]
        outputs = [output for used in assessment.usage if used.vehicle == vehicle for output in used.outputs]
        parts, body = multirotor(own, outputs)
        if not parts:
            parts, body = outline(own), FIXED_WING
        if parts:
            title = f"Vehicle {vehicle}" if len(vehicles) > 1 else "The aircraft from above"
            yield _Aircraft(title, parts, body)


def _plots(assessment: Assessment, gathered: Gathered) -> Iterator[_Shown]:
    """Yield the evidence of each subject, the worst first: what raised an alarm, friction, effectiveness."""
    curves, attitudes, networks = gathered.curves(), gathered.attitudes(), gathered.networks()
    drawn = 0
    for verdict in assessment.ranked():
        if verdict.vehicle is None or verdict.actuator == ALL:
            continue
        suspects = [item.fault for item in verdict.suspects]
        for axis in dict.fromkeys(
            _ATTITUDES[fault] or verdict.actuator for fault in suspects if fault in _ATTITUDES
        ):
            flown = attitudes.get((verdict.vehicle, axis))
            if flown is not None and drawn < _PLOTS:
                drawn += 1
                yield _attitude(verdict, axis, flown, assessment)
        alarms = [item.kind.removesuffix("_drift") for item in verdict.evidence]
        for fault in dict.fromkeys((*suspects, *alarms, "friction", "effectiveness")):
            curve = curves.get(Key(verdict.vehicle, verdict.actuator, fault))
            if curve is None or not curve.time_s.size or drawn == _PLOTS:
                continue
            drawn += 1
            what, limits = _limits(verdict, fault)
            since_s = verdict.since.flight_time_s if verdict.since and suspects else None
            drawing = plot(curve, limits, assessment.log.duration_s, since_s)
            last = curve.rows[-1]
            told = (
                f"{what}: {last[1]:.3g} at the end (95 % interval {last[0]:.3g} to {last[2]:.3g}), "
                f"highest {curve.rows[:, 1].max():.3g}, lowest {curve.rows[:, 1].min():.3g}"
            )
            bounds = "; ".join(f"{limit.name} {limit.value:.3g}" for limit in limits)
            title = f"{name(verdict, assessment)}: {what}"
            yield _Shown(title, f"{told}; {bounds}" if bounds else told, drawing)
        said = networks.get((verdict.vehicle, verdict.actuator))
        if said is not None and drawn < _PLOTS:
            drawn += 1
            yield _network(verdict, said, assessment)


def _network(verdict: Verdict, said: Curve, assessment: Assessment) -> _Shown:
    """Return the network's answer over the flight, as the paper's figures 16 to 19 show it."""
    drawing = plot(said, [Limit(0.5, "emergency above")], assessment.log.duration_s)
    network = verdict.network.model.name if verdict.network else "the network"
    told = "probability of an emergency; thick: ten seconds, at their middle; thin: each sample inside the"
    told += " training range"
    if verdict.network and verdict.network.share_of_samples is not None:
        told += f"; it calls {percent(verdict.network.share_of_samples)} of those in motion an emergency"
    return _Shown(f"{name(verdict, assessment)}: {network} on each sample", told, drawing)


def _attitude(verdict: Verdict, axis: str, curve: Curve, assessment: Assessment) -> _Shown:
    """Return the demanded and the flown angle about an axis, which a tracking or hard-over alarm rests on."""
    since_s = verdict.since.flight_time_s if verdict.since else None
    drawing = plot(curve, [], assessment.log.duration_s, since_s)
    assert curve.demanded is not None
    apart = np.abs(curve.rows[:, 1] - curve.demanded)
    told = f"{axis} angle, °: solid flown, dashed demanded"
    if np.isfinite(apart).any():
        worst = int(np.nanargmax(apart))
        told += f"; farthest apart by {apart[worst]:.0f}° at {clock(float(curve.time_s[worst]))}"
    return _Shown(f"{name(verdict, assessment)}: demanded and flown {axis} angle, °", told, drawing)


def _limits(verdict: Verdict, fault: str) -> tuple[str, list[Limit]]:
    """Return what a curve shows, with its unit, and the levels that it is compared with."""
    if fault == "effectiveness":
        reference = Limit(1.0, "as at the beginning")
        known = verdict.limits or AxisLimits()
        degraded = Limit(known.effectiveness_degraded, "degraded below")
        emergency = Limit(known.effectiveness_emergency, "emergency up to")
        return "control effectiveness, share of the reference", [reference, degraded, emergency]
    found = next((item for item in verdict.indicators if item.fault == fault), None)
    if found is None:
        return fault.replace("_", " "), []
    levels = [(found.limit, "degraded above"), (found.emergency, "emergency from")]
    unit = "" if found.unit == "1" else f", {found.unit}"
    return f"{found.quantity}{unit}", [Limit(value, word) for value, word in levels if value is not None]
