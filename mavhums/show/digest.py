"""What is said of an assessment, once for the terminal, Markdown, HTML and the page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from mavhums.core.conditions import SEVERITY, URGENCY, Condition
from mavhums.health.verdict import with_advice
from mavhums.health.verdict.obstacles import NO_WINGS, PROPELLERS_ONLY
from mavhums.results.assessment import Assessment
from mavhums.results.standing import Standing
from mavhums.results.verdict import ALL, Verdict
from mavhums.show.event_words import event_lines, foremost
from mavhums.show.servo_tables import ServoTable, reserve, usage
from mavhums.show.standing import sentences, since_words, soonest_words
from mavhums.show.verdict_words import (
    control_left,
    course,
    culprits,
    implausible,
    judged,
    network_cell,
    network_sentence,
)
from mavhums.show.words import (
    capital,
    clock,
    condition_word,
    flight_notes,
    friction,
    join,
    losses,
    name,
    percent,
)

NOT_JUDGED: Final = (
    "not judged (mavhums judges fixed wings, multirotors, steering, and servos with telemetry)"
)
"""What is said of a vehicle with neither wings nor rotors that are judged, after its kind."""

_NAMED: Final = 3  # more names than that push the other columns of a table out of sight
_SHORT: Final = 60  # a longer reason is given below the headline, with its remedy
_COMPARED: Final[tuple[Condition, ...]] = ("changed", "learning", "unchanged")


class Subject(NamedTuple):
    """A row: one verdict, or several on servos without telemetry, which differ in nothing but the name.

    ``past`` is the worst condition and when it was, where it is past. A cell that says nothing is None.
    """

    title: str
    verdict: Verdict
    past: tuple[Condition, str] | None
    control_left: str | None
    friction: str | None
    network: str | None
    since: str | None
    moving: str | None
    judged: str | None


class Paragraph(NamedTuple):
    """Why verdicts are as they are, and what to do; ``left_out`` counts the reasons that are not shown."""

    title: str
    condition: Condition
    why: str
    todo: str
    left_out: int


class Digest(NamedTuple):
    """What is said of an assessment.

    Attributes
    ----------
    headline
        The result in one line.
    gravest
        The gravest condition, which the exit code follows, too.
    assessment
        Without the vehicles of which nothing is judged.
    subjects
        The rows, worst first; where nothing is wrong, what is well comes first.
    faulty
        Verdicts that something is or was wrong, worst first.
    open
        What is not decided, or is compared with earlier flights, by reason.
    doubtful
        Subjects with values that no such actuator can have, and how many.
    unmonitored
        Servos that nothing reports on, by reason.
    without_wings
        A line for each vehicle of which nothing is judged.
    network
        What the networks say beside the physics, where the user asks for it.
    over_flights
        What stands, grows or changed over the flights, where there is a history.
    tables
        Reserve of torque, and the use of each vehicle's servos.
    events, foremost
        A line on each event of the flight, and up to three lines on the most important ones.
    whose, losses
        Sentences on whose flight it is; what the log lost.
    """

    headline: str
    gravest: Condition
    assessment: Assessment
    subjects: list[Subject]
    faulty: list[Verdict]
    open: list[Paragraph]
    doubtful: list[tuple[str, str]]
    unmonitored: list[Paragraph]
    without_wings: list[str]
    network: list[str]
    over_flights: list[str]
    tables: list[ServoTable]
    events: list[str]
    foremost: list[str]
    flight_notes: list[str]
    losses: str


def digest(assessment: Assessment, *, brief: bool = False) -> Digest:
    """Return what is said of an assessment.

    Parameters
    ----------
    assessment
        The verdicts of one log.
    brief
        Of several reasons only the first one, which binds, and its remedy.
    """
    ranked = assessment.ranked()
    rest, lines = _without_wingless(assessment)
    several = len(rest.usage) > 1
    conditions: tuple[Condition, ...] = (*_COMPARED, "normal", "undecided")
    tables = [reserve(rest), *(usage(used, several=several) for used in rest.usage)]
    return Digest(
        headline=_headline(rest, lines),
        gravest=ranked[0].gravest if ranked else "undecided",
        assessment=rest,
        subjects=[_subject(alike, rest) for alike in _together(listed(rest))],
        # What another finding explains comes after it.
        faulty=sorted(
            (verdict for verdict in rest.ranked() if verdict.worst in ("degraded", "emergency")),
            key=lambda verdict: verdict.consequence_of is not None,
        ),
        open=[found for condition in conditions for found in _by_reason(rest, condition, brief=brief)],
        doubtful=[(name(v, rest), odd) for v in rest.ranked() if (odd := implausible(v))],
        unmonitored=[*_by_reason(rest, "unmonitored", brief=brief)],
        without_wings=lines if rest.verdicts else [],  # else the headline says it
        network=_network(rest),
        over_flights=[f"{title}: {said}" for title, said in _over_flights(rest)],
        tables=[table for table in tables if table],
        events=event_lines(assessment),
        foremost=foremost(assessment),
        flight_notes=flight_notes(assessment.log),
        losses=losses(assessment.log.losses),
    )


def headline(assessment: Assessment) -> str:
    """Return the result in one line: what has failed and since when, or that no failure is known."""
    return _headline(*_without_wingless(assessment))


def advice(verdict: Verdict) -> str:
    """Return the recommended action, also of a verdict from a file that has none."""
    return verdict.advice or with_advice(verdict).advice or ""


def _over_flights(assessment: Assessment) -> Iterator[tuple[str, str]]:
    for standing in assessment.standings:
        for said in sentences(standing):
            yield _name(standing, assessment), said


def _name(standing: Standing, assessment: Assessment) -> str:
    own = f"{standing.actuator} control" if standing.subject == "axis" else standing.actuator
    several = len({other.vehicle for other in assessment.verdicts}) > 1
    return f"{standing.vehicle}: {own}" if several else own


def _headline(assessment: Assessment, without_wings: Sequence[str]) -> str:
    """Return the result in one line; of what is well in this flight, whether it is over the flights, too."""
    text = _of_the_flight(assessment, without_wings)
    shown = {(one.vehicle, one.actuator): one.gravest for one in assessment.verdicts}
    for one in assessment.standings:
        alone = shown.get((one.vehicle, one.actuator), "normal")
        if SEVERITY[one.condition] > max(SEVERITY[alone], 0):
            text += f"; {_name(one, assessment)} {one.condition} {since_words(one)}".rstrip()
        if one.growth is not None:
            text += f"; {_name(one, assessment)} grows: {soonest_words(one.growth)}"
    return text


def _of_the_flight(assessment: Assessment, without_wings: Sequence[str]) -> str:
    ranked = assessment.ranked()
    if not ranked:
        return "; ".join(without_wings) or "No actuator was found in this log"
    word = ranked[0].gravest
    worst = [verdict for verdict in ranked if verdict.gravest == word]
    if SEVERITY[word] <= SEVERITY["normal"] and any(verdict.subject != "actuator" for verdict in ranked):
        return _what_was_judged(assessment)
    if word == "unmonitored":
        well = [verdict for verdict in ranked if verdict.gravest == "normal"]
        none = f"{_count(ranked, ranked)} unmonitored: {ranked[0].reason}"
        return f"{_count(well, ranked)} normal, the others unmonitored" if well else none
    if SEVERITY[word] <= SEVERITY["normal"] or word == "learning":
        explained = worst if word in ("learning", "undecided") else []
        why = list(dict.fromkeys(verdict.reason or "" for verdict in explained))
        if ranked[0].actuator == ALL and word == "undecided":
            return f"Undecided: {why[0].rstrip('.')}"
        return f"{_count(worst, ranked)} {word}" + (
            f": {why[0].rstrip('.')}" if len(why) == 1 and why[0] else ""
        )
    # One fault is one finding: what another one explains does not head the answer.
    worst = [verdict for verdict in worst if not verdict.consequence_of] or worst
    text = f"{join(name(verdict, assessment) for verdict in worst)}: {word.upper()}"
    if len(worst) > 1:
        return text
    past = course(worst[0])
    if past is not None:
        text = f"{text} {past[1]}, then {worst[0].condition}"
    if suspected := culprits(worst[0]):
        text = f"{text}, {' or '.join(suspected)}"
    since = worst[0].since if past is None else None
    if since and not since.flight_time_s and word == "degraded":
        # A fault that is there from the first second began in an earlier flight, where one shows it.
        for one in assessment.standings:
            known = (one.vehicle, one.actuator) == (worst[0].vehicle, worst[0].actuator)
            if known and one.since_flight and one.since_flight < one.flights:
                return f"{text} {since_words(one)}"
    return f"{text} since {clock(since.flight_time_s)}" if since else text


def _what_was_judged(assessment: Assessment) -> str:
    """Return what was judged and found well, then what was not judged and why, then what nothing monitors."""
    open_ = [v for v in assessment.verdicts if v.gravest == "undecided"]
    unmonitored = sum(v.gravest == "unmonitored" for v in assessment.verdicts)
    well: tuple[Condition, ...] = ("normal", "unchanged")
    alike = {word: [name(v, assessment) for v in assessment.verdicts if v.gravest == word] for word in well}
    parts = [f"{join(names)} {condition_word(word)}" for word, names in alike.items() if names]
    if open_:
        reasons = list(dict.fromkeys(v.reason or "" for v in open_))
        alone = len(reasons) == 1 and not parts and len(reasons[0]) <= _SHORT
        parts.append(
            f"{join(name(v, assessment) for v in open_)} not judged{f' ({reasons[0]})' if alone else ''}"
        )
    if unmonitored:
        parts.append("servos unmonitored" if unmonitored > 1 else "the servos are unmonitored")
    return capital("; ".join(parts))


def _count(part: Sequence[Verdict], whole: Sequence[Verdict]) -> str:
    if len(part) < len(whole):
        return f"{len(part)} of {len(whole)} actuators"
    return "The only actuator is" if len(whole) == 1 else f"All {len(whole)} actuators"


def listed(assessment: Assessment) -> list[Verdict]:
    """Return the verdicts worst first, axes before servos; where nothing is wrong, what is well comes first.

    A verdict that something is wrong must not be overlooked; among others, what could not be judged would
    hide that all that could be judged is well.
    """
    ranked = sorted(assessment.ranked(), key=lambda verdict: verdict.subject != "axis")
    wrong = any(SEVERITY[verdict.gravest] > SEVERITY["normal"] for verdict in ranked)
    order = URGENCY if wrong else SEVERITY
    return sorted(ranked, key=lambda verdict: -order[verdict.gravest])


def _together(verdicts: Sequence[Verdict]) -> Iterator[list[Verdict]]:
    """Yield the verdicts, those on servos without telemetry as one: they differ in nothing but the name."""
    groups: dict[object, list[Verdict]] = {}
    for place, verdict in enumerate(verdicts):
        alike = verdict.condition == verdict.worst == "unmonitored"
        key = (verdict.vehicle, verdict.reason, verdict.remedy) if alike else place
        groups.setdefault(key, []).append(verdict)
    yield from groups.values()


def _title(alike: Sequence[Verdict], assessment: Assessment) -> str:
    """Return the subject of verdicts in one row: of a servo without telemetry it is the wear alone."""
    many = len(alike) > _NAMED
    names = f"{len(alike)} servos" if many else join(name(verdict, assessment) for verdict in alike)
    unseen = alike[0].gravest == "unmonitored" and alike[0].actuator != ALL
    return f"wear of {names}" if unseen else names


def _subject(alike: Sequence[Verdict], assessment: Assessment) -> Subject:
    verdict = alike[0]
    moving = verdict.coverage.moving_fraction if "V7" in verdict.provenance else None
    return Subject(
        title=_title(alike, assessment),
        verdict=verdict,
        past=course(verdict),
        control_left=control_left(verdict),
        friction=friction(verdict.friction_nm) if verdict.friction_nm else None,
        network=network_cell(verdict),
        since=clock(verdict.since.flight_time_s) if verdict.since else None,
        moving=None if moving is None else percent(moving),
        judged=judged(verdict),
    )


def _by_reason(assessment: Assessment, condition: Condition, *, brief: bool) -> Iterator[Paragraph]:
    """Yield the verdicts of a condition by reason and remedy, so that neither is said twice."""
    groups: dict[tuple[str, str], list[Verdict]] = {}
    for verdict in assessment.verdicts:
        if verdict.condition == condition and (verdict.reason or condition != "normal"):
            why = (verdict.reason or "no reason was given").rstrip(".")
            todo = (verdict.remedy or advice(verdict)).rstrip(".")
            if brief:
                why, todo = why.partition("; ")[0], todo.partition("; ")[0]
            groups.setdefault((why, todo), []).append(verdict)
    for (why, todo), alike in groups.items():
        names = (
            _title(alike, assessment)
            if brief and condition == "unmonitored"
            else join(name(verdict, assessment) for verdict in alike)
        )
        reasons = {reason for verdict in alike for reason in (verdict.reason or why).rstrip(".").split("; ")}
        yield Paragraph(names, condition, why, todo, len(reasons) - 1 if brief else 0)


def _network(assessment: Assessment) -> list[str]:
    """Return what the networks say beside the physics, once for all actuators of which they say the same."""
    said: dict[str, list[str]] = {}
    for verdict in assessment.ranked():
        if sentence := network_sentence(verdict):
            said.setdefault(sentence, []).append(name(verdict, assessment))
    return [f"{join(names)}: {sentence}" for sentence, names in said.items()]


def _without_wingless(assessment: Assessment) -> tuple[Assessment, list[str]]:
    """Return an assessment without the vehicles of which nothing is judged, and a line on each of them.

    A copter, a boat, a submarine without telemetry of its servos: neither a reason nor a remedy for each of
    its axes and actuators means anything to its owner.
    """
    by_vehicle: dict[int | None, list[Verdict]] = {}
    for verdict in assessment.verdicts:
        by_vehicle.setdefault(verdict.vehicle, []).append(verdict)
    lines = {vehicle: line for vehicle, own in by_vehicle.items() if (line := _wingless(own))}
    if not lines:
        return assessment, []
    rest = {
        "verdicts": tuple(verdict for verdict in assessment.verdicts if verdict.vehicle not in lines),
        "usage": tuple(used for used in assessment.usage if used.vehicle not in lines),
    }
    several = len(by_vehicle) > 1
    said = [f"vehicle {v}: {line}" if several else capital(line) for v, line in lines.items()]
    return assessment.model_copy(update=rest), said


def _wingless(own: Sequence[Verdict]) -> str | None:
    """Return what is said of a vehicle without wings and without servos that report; None of any other."""
    axes = next((v for v in own if v.subject == "axis" and v.remedy == NO_WINGS), None)
    if axes is None:
        return None
    for verdict in own:
        silent = verdict.condition == "unmonitored" or verdict.remedy == PROPELLERS_ONLY
        if verdict is not axes and not silent:
            return None
    kind = (axes.reason or "").partition(":")[0]
    return f"{kind}: {NOT_JUDGED}"
