"""The result of an assessment in one line."""

from __future__ import annotations

from mavhums.core.conditions import SEVERITY
from mavhums.report.assessment import ALL, Assessment, Verdict
from mavhums.show._listing import without_wingless
from mavhums.show._standing import course
from mavhums.show._words import clock, explained, join, name, undecided

__all__ = ["headline"]

_SHORT = 60  # a longer reason is told below, with its remedy


def headline(assessment: Assessment) -> str:
    """Return the result in one line: what has failed and since when, or that no failure is known."""
    assessment, wingless = without_wingless(assessment)
    ranked = assessment.ranked()
    if not ranked:
        return "; ".join(wingless) or "No actuator was found in this log"
    word = ranked[0].gravest
    worst = [verdict for verdict in ranked if verdict.gravest == word]
    if SEVERITY[word] <= SEVERITY["normal"] and any(verdict.subject == "axis" for verdict in ranked):
        return _what_could_be_judged(assessment)
    if word == "unmonitored":
        worst = [verdict for verdict in ranked if verdict.gravest == "normal"]
        none = f"{_all(ranked, ranked)} unmonitored: {ranked[0].reason}"
        return f"{_all(worst, ranked)} normal, the others unmonitored" if worst else none
    if word in ("normal", "unchanged"):
        return f"{_all(worst, ranked)} {word}"
    if word == "learning":
        flights = [why for condition, why, _ in explained(assessment) if condition == word]
        return f"{_all(worst, ranked)} learning" + (f": {flights[0]}" if len(flights) == 1 else "")
    if word == "undecided":
        why = list(undecided(assessment))
        if ranked[0].actuator == ALL:
            return f"Undecided: {why[0][0]}"
        told = f": {why[0][0]}" if len(why) == 1 else ""
        return f"{_all(worst, ranked)} undecided{told}"
    text = f"{join(name(verdict, assessment) for verdict in worst)}: {word.upper()}"
    if len(worst) > 1:
        return text
    past = course(worst[0])
    if past is not None:
        text = f"{text} {past[1]}, then {worst[0].condition}"
    if worst[0].surfaces:
        bare = [surface.removesuffix(f" (moves with {worst[0].actuator})") for surface in worst[0].surfaces]
        text = f"{text}, {' or '.join(bare)}"
    if past is not None:
        return text
    return f"{text} since {clock(worst[0].since.flight_time_s)}" if worst[0].since else text


def _what_could_be_judged(assessment: Assessment) -> str:
    """Return what was judged and found well, then what was not judged and why, then what nothing monitors."""
    ranked = assessment.ranked()
    well = [name(v, assessment) for v in assessment.verdicts if v.gravest == "normal"]
    open_ = [v for v in assessment.verdicts if v.gravest == "undecided"]
    silent = sum(v.gravest == "unmonitored" for v in ranked)
    parts = [f"{join(well)} normal"] if well else []
    if open_:
        told = list(dict.fromkeys(v.reason or "" for v in open_))
        why = f" ({told[0]})" if len(told) == 1 and not well and len(told[0]) <= _SHORT else ""
        parts.append(f"{join(name(v, assessment) for v in open_)} not judged{why}")
    if silent:
        parts.append("servos unmonitored" if silent > 1 else "the servos are unmonitored")
    text = "; ".join(parts)
    return f"{text[:1].upper()}{text[1:]}"


def _all(part: list[Verdict], whole: list[Verdict]) -> str:
    if len(part) < len(whole):
        return f"{len(part)} of {len(whole)} actuators"
    return "The only actuator is" if len(whole) == 1 else f"All {len(whole)} actuators"
