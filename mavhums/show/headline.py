"""The headline of an assessment: what has failed and since when, or what was judged and found well."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from mavhums.actuator.telemetry import TO_BE_JUDGED
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.results.assessment import Assessment, Judgeable
from mavhums.results.reasons import NO_WINGS, PROPELLERS_ONLY
from mavhums.results.verdict import ALL, Verdict
from mavhums.show.standing import sentences, since_words, soonest_words
from mavhums.show.verdict_words import course, culprits
from mavhums.show.words import capital, clock, condition_word, join, name

NOT_JUDGED: Final = (
    "not judged (mavhums judges fixed wings, multirotors, steering, and servos with telemetry)"
)
"""What is said of a vehicle with neither wings nor rotors that are judged, after its kind."""

_SILENT: Final = (PROPELLERS_ONLY, TO_BE_JUDGED)
"""Remedies for servos on which nothing reports."""
_SHORT: Final = 60  # a longer reason is given below the headline, with its remedy


def headline(assessment: Assessment) -> str:
    """Return the result in one line: what has failed and since when, or that no failure is known.

    Of what is well in this flight it has whether it is so over the flights, too.
    """
    return headline_of(*judged_vehicles(assessment))


def over_flights(assessment: Assessment) -> Iterator[str]:
    """Yield what stands, grows or changed over the flights, where there is a history."""
    for standing in assessment.standings:
        for said in sentences(standing):
            yield f"{name(standing, assessment)}: {said}"


def headline_of(assessment: Assessment, without_wings: Sequence[str]) -> str:
    """Return the headline on the vehicles that are judged, from a line for each of the others."""
    text = _of_the_flight(assessment, without_wings)
    shown = {(one.vehicle, one.actuator): one.gravest for one in assessment.verdicts}
    for one in assessment.standings:
        alone = shown.get((one.vehicle, one.actuator), "normal")
        if SEVERITY[one.condition] > max(SEVERITY[alone], 0):
            text += f"; {name(one, assessment)} {one.condition} {since_words(one)}".rstrip()
        if one.growth is not None:
            text += f"; {name(one, assessment)} grows: {soonest_words(one.growth)}"
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
        return f"{_count(ranked, ranked)} unmonitored: {ranked[0].reason}"
    if word == "normal" and ranked[-1].gravest == "unmonitored":
        return f"{_count(worst, ranked)} normal, the others unmonitored"
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


def judged_vehicles(assessment: Assessment) -> tuple[Assessment, list[str]]:
    """Return an assessment without the vehicles of which nothing is judged, and a line on each of them.

    A copter, a boat, a submarine without telemetry of its servos: neither a reason nor a remedy for each of
    its axes and actuators means anything to its owner.
    """
    by_vehicle: dict[int | None, list[Verdict]] = {}
    for verdict in assessment.verdicts:
        by_vehicle.setdefault(verdict.vehicle, []).append(verdict)
    lines = {vehicle: line for vehicle, own in by_vehicle.items() if (line := wingless(own))}
    if not lines:
        return assessment, []
    rest = {
        "verdicts": tuple(verdict for verdict in assessment.verdicts if verdict.vehicle not in lines),
        "usage": tuple(used for used in assessment.usage if used.vehicle not in lines),
    }
    several = len(by_vehicle) > 1
    said = [f"vehicle {v}: {line}" if several else capital(line) for v, line in lines.items()]
    return assessment.model_copy(update=rest), said


def wingless(subjects: Sequence[Verdict | Judgeable]) -> str | None:
    """Return what is said of a vehicle without wings and without servos that report; None of any other."""
    axes = next((one for one in subjects if one.remedy == NO_WINGS), None)
    if axes is None or any(one.remedy not in _SILENT for one in subjects if one is not axes):
        return None
    return f"{(axes.reason or '').partition(':')[0]}: {NOT_JUDGED}"
