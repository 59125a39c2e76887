"""The answer as one HTML page without scripts: for a browser without a network, for a phone, for paper."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from mavhums.core.about import __version__
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.output import printable
from mavhums.results.assessment import Assessment
from mavhums.results.verdict import Verdict
from mavhums.show.digest import Subject, advice, digest
from mavhums.show.evidence import EvidenceCollector, evidence
from mavhums.show.html_plot import Plot, flight_charts, plot
from mavhums.show.outline import FIXED_WING, DrawnSurface, multirotor, outline
from mavhums.show.verdict_words import certainty, explanation, implausible
from mavhums.show.words import COLOURS, clock, finding, join

if TYPE_CHECKING:
    from jinja2 import Environment

_ROWS, _FINDINGS, _LIKE = 200, 8, 6
_VEHICLES, _OUTPUTS = 8, 32
_PROOF = 2  # plots of what is wrong that come before the tables
_LETTERS: Final = 600

ICONS: Final[dict[Condition, str]] = {
    "normal": "✓",
    "unchanged": "=",
    "changed": "≠",
    "degraded": "▲",
    "emergency": "✖",
    "learning": "…",
    "undecided": "?",
    "unmonitored": "○",
}
"""A sign per condition, so that no reader depends on its colour."""


@cache
def environment(package: str) -> Environment:
    """Return the environment of a package's templates, which may include those of ``mavhums.show``.

    Parameters
    ----------
    package
        Import name of a package with a folder ``templates``.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    folders = dict.fromkeys((package, "mavhums.show"))
    made = Environment(
        loader=ChoiceLoader([PackageLoader(folder) for folder in folders]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_plain,
    )
    made.filters |= {"clock": clock, "moment": moment}
    made.globals |= {"icons": ICONS, "colours": COLOURS}
    return made


def moment(utc: str) -> str:
    """Return a time as a reader writes it.

    Examples
    --------
    >>> moment("2026-01-01T09:01:07.003611+00:00")
    '2026-01-01 09:01:07 UTC'
    """
    return f"{utc[:10]} {utc[11:19]} UTC"


def _plain(value: object) -> object:
    """Return a text without control characters and of bounded length."""
    if type(value) is not str:
        return value
    text = printable(value)
    return text if len(text) <= _LETTERS else f"{text[:_LETTERS]}…"


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


class _DescribedPlot(NamedTuple):
    """A plot with the words that describe it."""

    title: str
    caption: str
    drawing: Plot


class _Aircraft(NamedTuple):
    """The outline of one vehicle."""

    title: str
    parts: list[DrawnSurface]
    body: Sequence[str]


class AssessmentHeadline(NamedTuple):
    """An assessment in a line: its gravest condition, the finding, and what to do."""

    condition: Condition
    headline: str
    todo: str


def in_brief(assessment: Assessment) -> AssessmentHeadline:
    """Return the assessment in a line.

    Examples
    --------
    >>> import mavhums
    >>> in_brief(mavhums.analyse("flight.tlog")).condition
    'emergency'
    """
    said = digest(assessment)
    first = _first([_answer(one) for one in said.subjects[:_ROWS]])
    return AssessmentHeadline(said.gravest, said.headline, first.todo if first else "")


def page(assessment: Assessment, gathered: EvidenceCollector) -> str:
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
    >>> text = page(mavhums.analyse("flight.tlog"), EvidenceCollector())
    >>> "<h1" in text, "<script" in text
    (True, False)
    """
    values = _values(assessment, gathered)
    plots = [
        _DescribedPlot(
            one.title, one.caption, plot(one.curve, one.limits, assessment.log.duration_s, one.since_s)
        )
        for one in evidence(values["said"].assessment, gathered)
    ]
    faulty = SEVERITY[values["said"].gravest] > SEVERITY["normal"]
    return _rendered("report.html", values | {"plots": plots, "proof": _PROOF if faulty else 0})


def parts(assessment: Assessment, gathered: EvidenceCollector, heading: str = "h2") -> dict[str, Any]:
    """Return the assessment in parts for a page that draws the curves itself.

    Parameters
    ----------
    assessment, gathered
        As for :func:`page`.
    heading
        Tag of the headline.

    Returns
    -------
    dict
        ``answer`` and ``rest``, markup in which every text is escaped, and ``curves``, as
        :func:`mavhums.show.html_plot.flight_charts` returns them.
    """
    values = _values(assessment, gathered)
    shown = evidence(values["said"].assessment, gathered)
    return {
        "answer": _rendered("_answer.html", values | {"heading": heading, "brief": True}),
        "curves": flight_charts(shown, gathered, assessment.log.duration_s),
        "rest": _rendered("_rest.html", values),
    }


def _rendered(template: str, values: dict[str, Any]) -> str:
    return environment("mavhums.show").get_template(template).render(**values)


def _values(assessment: Assessment, gathered: EvidenceCollector) -> dict[str, Any]:
    """Return what the templates of an assessment need, but for the curves."""
    said = digest(assessment)
    log = assessment.log
    answers = [_answer(one) for one in said.subjects[:_ROWS]]
    return {
        "assessment": assessment,
        "said": said,
        "answers": answers,
        "first": _first(answers),
        "heading": "h1",
        "brief": False,  # why, and how sure, only among the reasons
        "left_out": max(len(said.subjects) - _ROWS, 0),
        "file": PurePath(log.path.replace("\\", "/")).name if log.path else "a live link",
        "aircraft": list(_aircraft(said.assessment)),
        "tables": [table._replace(rows=table.rows[:_OUTPUTS]) for table in said.tables[:_VEHICLES]],
        "notices": gathered.notices(),
        "texts": gathered.texts,
        "version": __version__,
    }


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
