"""The headline of an assessment: what has failed and since when, or what was judged and found well.

Of many logs it is a line in their table.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from mavhums.actuator.telemetry import TO_BE_JUDGED
from mavhums.core.conditions import SEVERITY, URGENCY, Condition
from mavhums.core.errors import GRAVEST_FIRST, ExitCode, MavhumsError
from mavhums.health.verdict import with_advice
from mavhums.results.assessment import Assessment
from mavhums.results.reasons import NO_WINGS, PROPELLERS_ONLY
from mavhums.results.standing import Standing
from mavhums.results.verdict import Evidence, Verdict
from mavhums.show.blocks import Cell, Column, Headline, Mark, TableBlock
from mavhums.show.event_words import gravest_event
from mavhums.show.outline import outputs_of
from mavhums.show.standing import mark_of, sentences, since_words, soonest_words
from mavhums.show.verdict_words import LOSS, course, culprits, is_reliable, kept_percent
from mavhums.show.words import capital, clock, name, names, place_of

NOT_JUDGED: Final = (
    "not judged (mavhums judges fixed wings, multirotors, steering, and servos with telemetry)"
)
"""What is said of a vehicle with neither wings nor rotors that are judged, after its kind."""

_SILENT: Final = (PROPELLERS_ONLY, TO_BE_JUDGED)
"""Remedies for servos on which nothing reports."""
_LIKE: Final = 6  # findings whose advice it has
_SHORT: Final = 80  # a longer reason is given below the headline
_MOST: Final = 2  # faults of a headline; the others are counted
_UNNAMED: Final = re.compile(r"servo \d+")
_FIRST: Final = re.compile(r"(motor \d+) first")
_SIDE: Final = re.compile(r"\b(left|right)\b")


def headline(assessment: Assessment) -> Headline:
    """Return the assessment in a line, with what to do about the gravest findings.

    Examples
    --------
    >>> import mavhums
    >>> headline(mavhums.analyse("flight.tlog")).condition
    'emergency'
    """
    rest, without_wings = judged_vehicles(assessment)
    (mark, text), ranked = _headline_of(rest, without_wings), rest.ranked()
    worst = _gravest_first(ranked)
    like = [verdict for verdict in worst if verdict.subject == worst[0].subject]
    todo = [*map(_todo, like[:_LIKE])]
    if event := gravest_event(assessment):
        # What was not judged has its remedy below.
        faulty = bool(worst) and SEVERITY[worst[0].gravest] > SEVERITY["normal"]
        todo = [*todo, event.todo] if faulty else [event.todo]
    return Headline(text, mark.condition, "; ".join(dict.fromkeys(todo)), word=mark.word)


def over_flights(assessment: Assessment) -> Iterator[str]:
    """Yield the findings, the growth and the steps over the flights, where there is a history."""
    for standing in assessment.standings:
        for said in sentences(standing):
            yield f"{name(standing, assessment)}: {said}"


def _headline_of(assessment: Assessment, without_wings: Sequence[str]) -> tuple[Mark, str]:
    """Return mark and headline on the vehicles that are judged, from a line for each of the others."""
    mark, text = _of_the_flight(assessment, without_wings)
    if event := gravest_event(assessment):
        faulty = SEVERITY[mark.condition] > SEVERITY["normal"]
        own = Mark(event.condition, event.name)
        mark, text = (mark, f"{text}; {event.text}") if faulty else (own, f"{event.text}; {text}")
    shown = {(one.vehicle, one.actuator): one.gravest for one in assessment.verdicts}
    over, said = list[Standing](), list[str]()
    for one in assessment.standings:
        alone = shown.get((one.vehicle, one.actuator), "normal")
        if SEVERITY[one.condition] > max(SEVERITY[alone], 0):
            over.append(one)
            said.append(f"{name(one, assessment)} {one.condition} {since_words(one)}".rstrip())
        if one.growth is not None:
            over.append(one)
            said.append(f"{name(one, assessment)} grows: {soonest_words(one.growth)}")
    if over and SEVERITY[mark.condition] <= SEVERITY["normal"]:
        return mark_of(min(over, key=lambda one: one.rank)), "; ".join([*said, text])
    return mark, "; ".join([text, *said])


def _gravest_first(ranked: Sequence[Verdict]) -> list[Verdict]:
    """Return the gravest verdicts without those that another one explains, actuators before axes.

    Telemetry names the part, an axis only what it does to the aircraft.
    """
    worst = [verdict for verdict in ranked if verdict.gravest == ranked[0].gravest]
    worst = [verdict for verdict in worst if not verdict.consequence_of] or worst
    return sorted(worst, key=lambda verdict: verdict.subject == "axis")


def _todo(verdict: Verdict) -> str:
    """Return what to do: about a fault, whatever has become unknown since, else about what is missing."""
    faulty = SEVERITY[verdict.gravest] > SEVERITY["normal"]
    return advice(verdict) if faulty else remedy(verdict)


def remedy(verdict: Verdict) -> str:
    """Return what to do about what is missing."""
    return (verdict.remedy or advice(verdict)).rstrip(".")


def advice(verdict: Verdict) -> str:
    """Return the recommended action, also of a verdict from a file that has none."""
    return verdict.advice or with_advice(verdict).advice or ""


def _of_the_flight(assessment: Assessment, without_wings: Sequence[str]) -> tuple[Mark, str]:
    ranked = assessment.ranked()
    if not ranked:
        return Mark("undecided"), "; ".join(without_wings) or "no actuator was found in this log"
    word = ranked[0].gravest
    if SEVERITY[word] <= SEVERITY["normal"]:
        return _what_was_judged(assessment)
    worst = _gravest_first(ranked)
    named = worst[0].subject == "actuator"
    shown = [_fault(verdict, assessment, by_axis=named) for verdict in worst[:_MOST]]
    more = [f"{len(worst) - _MOST} more"] if len(worst) > _MOST else []
    return Mark(word), "; ".join([*shown, *more])


def _fault(verdict: Verdict, assessment: Assessment, *, by_axis: bool) -> str:
    """Return what has failed, in which way, and since when; of an axis which part, unless ``by_axis``."""
    who, what = _who(verdict, assessment, by_axis=by_axis), _what(verdict)
    if who.endswith(f"{verdict.actuator} control:"):
        what = what.replace(f"{verdict.actuator} control down", "down")
        who = who.rstrip(":") if what.startswith((" down", f" {verdict.gravest}")) else who
    text = f"{who}{what}"
    past, since = course(verdict), verdict.since
    if past is not None:
        return f"{text}, {past[1]}, then {verdict.condition}"
    if since and not since.flight_time_s and verdict.condition == "degraded":
        # A fault that is there from the first second began in an earlier flight, where one shows it.
        for one in assessment.standings:
            known = (one.vehicle, one.actuator) == (verdict.vehicle, verdict.actuator)
            if known and one.since_flight and one.since_flight < one.flights:
                return f"{text} {since_words(one)}"
    return f"{text} since {clock(since.flight_time_s)}" if since else text


def _who(verdict: Verdict, assessment: Assessment, *, by_axis: bool) -> str:
    """Return the part that failed as its owner names it; of an axis those that may have."""
    own = name(verdict, assessment)
    if verdict.subject == "axis":
        parts = culprits(verdict)
        if not parts or by_axis:
            return f"{own}:"
        vehicle = own.partition(": ")[0] + ": " if ": " in own else ""
        inferred = verdict.candidates and (verdict.candidates[0].probability or 0.0) > 0.0
        return f"{vehicle}{_either(parts, verdict.actuator)}{', probably' if inferred else ''}:"
    for output in outputs_of(assessment, verdict.vehicle):
        if output.name == verdict.actuator:
            bearing = output.bearing_deg
            return f"{own} ({f'servo {output.servo}' if bearing is None else place_of(bearing)})"
    return own


def _either(parts: Sequence[str], axis: str) -> str:
    """Return parts of which at least one failed; what they are is said once.

    Examples
    --------
    >>> _either(["aileron (servo 1)", "aileron (servo 9)"], "roll"), _either(["servo 5"], "roll")
    ('aileron (servo 1, servo 9 or both)', 'servo 5 (moves with roll)')
    """
    kinds = {part.partition(" (")[0] for part in parts}
    alike = len(parts) > 1 and len(kinds) == 1
    numbers = [part.partition(" (")[2].rstrip(")") for part in parts] if alike else parts
    text = ", ".join(numbers) + {1: "", 2: " or both"}.get(len(parts), " or several")
    if alike:
        return f"{kinds.pop()} ({text})"
    unnamed = all(_UNNAMED.fullmatch(part) for part in parts)
    return f"{text} ({'moves' if len(parts) == 1 else 'they move'} with {axis})" if unnamed else text


def _what(verdict: Verdict) -> str:
    """Return in which way a part failed, as the evidence has it."""
    kinds = {item.kind: item for item in verdict.evidence if item.condition in ("degraded", "emergency")}
    kinds = kinds or {item.kind: item for item in verdict.evidence}
    if verdict.subject == "motor" and (thrust := kinds.get("thrust")):
        first = _FIRST.search(thrust.rule)
        which = f" failed, {first[1]} first: it" if first else ""
        return f"{which} lost {100 - kept_percent(verdict, thrust)} % of its thrust"
    if verdict.subject == "actuator":
        return _of_actuator(verdict, kinds)
    axis, left = verdict.actuator, kinds.get("effectiveness")
    said = []
    if "hard_over" in kinds:
        side = _SIDE.search(kinds["hard_over"].rule)
        said.append(f"seems deflected or stuck{f', pulls {side[1]}' if side else ''}")
    if "slow" in kinds:
        said.append(f"slow, {kinds['slow'].value:.2g} s late")
    if left is not None and (course(verdict) or is_reliable(verdict)):
        said.append(f"{axis} control down to {kept_percent(verdict, left)} %")
    if "tracking" in kinds and not said:
        said.append(kinds["tracking"].rule.partition(": ")[2].partition(" for ")[0])
    return f" {', '.join(said) or verdict.gravest}"


def _of_actuator(verdict: Verdict, kinds: dict[str, Evidence]) -> str:
    if any(kind.startswith("jam") for kind in kinds):
        return " stuck"
    if not kinds:
        return f" {verdict.gravest}"
    # Where a limit decides, too, it says more than the own baseline.
    item = sorted(kinds.values(), key=lambda each: each.kind == each.fault)[-1]
    kind, beside = item.fault, "limit" if item.kind == item.fault else "own baseline"
    units = {shown.fault: shown.unit for shown in verdict.indicators} | {"friction": "N·m"}
    if kind == "friction" and verdict.friction_nm and beside == "limit":
        item = item.model_copy(update={"value": verdict.friction_nm.estimate})
    unit = f" {units[kind]}" if units.get(kind, "1") != "1" else ""
    limit = f" ({beside} {item.limit:.3g})" if item.limit is not None else ""
    return f": {kind.replace('_', ' ')} {item.value:#.3g}{unit}{limit}"


def _what_was_judged(assessment: Assessment) -> tuple[Mark, str]:
    """Return what was judged and found well, then what was not judged and why, then what nothing monitors."""
    by: dict[Condition, list[Verdict]] = {}
    for verdict in assessment.verdicts:
        by.setdefault(verdict.gravest, []).append(verdict)
    parts = [*_well(by.get("normal", ()), assessment)]
    for word in ("unchanged", "learning"):
        parts += [f"{names(by[word], assessment)} {word}"] if word in by else []
    if open_ := by.get("undecided"):
        reasons = list(dict.fromkeys((v.reason or "").rstrip(".").partition("; ")[0] for v in open_))
        alone = len(reasons) == 1 and len(by.keys() - {"unmonitored"}) == 1 and len(reasons[0]) <= _SHORT
        parts.append(f"{names(open_, assessment)} not judged{f': {reasons[0]}' if alone else ''}")
    if unseen := by.get("unmonitored"):
        alone = len(by) == 1
        why = f": {unseen[0].reason}" if alone and unseen[0].reason else ""
        parts.append(f"{names(unseen, assessment)} unmonitored{why}" if alone else "servos unmonitored")
    counted = by.keys() - {"unmonitored"} or by.keys()
    gravest = max(counted, key=URGENCY.__getitem__)
    partly = gravest in ("undecided", "learning") and counted & {"normal", "unchanged"}
    return Mark(gravest, "partly judged" if partly else ""), "; ".join(parts)


def _well(normal: Sequence[Verdict], assessment: Assessment) -> Iterator[str]:
    """Yield what is normal, with the loss that was excluded: a smaller one may be there."""
    for subject in ("axis", "motor", "actuator"):
        own = [verdict for verdict in normal if verdict.subject == subject]
        losses = [verdict.coverage.excluded_loss for verdict in own]
        known = [loss for loss in losses if loss is not None]
        if subject == "axis" and own and all(verdict.coverage.excluded for verdict in own):
            yield f"{names(own, assessment)}: no loss of {LOSS} or more"
        elif own and len(known) == len(own):
            yield f"{names(own, assessment)}: none lost {100 * max(known):.0f} % or more of its thrust"
        elif own:
            yield f"{names(own, assessment)} within {'their' if len(own) > 1 else 'its'} limits"


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


def wingless(verdicts: Sequence[Verdict]) -> str | None:
    """Return what is said of a vehicle without wings and without servos that report; None of any other."""
    axes = next((one for one in verdicts if one.remedy == NO_WINGS), None)
    if axes is None or any(one.remedy not in _SILENT for one in verdicts if one is not axes):
        return None
    return f"{(axes.reason or '').partition(':')[0]}: {NOT_JUDGED}"


class LogLine(NamedTuple):
    """One log: its mark (None if it cannot be read), what was found, and its exit code."""

    log: Path
    worst: Mark | None
    what: str
    code: ExitCode


def line_of(log: Path, outcome: Assessment | MavhumsError) -> LogLine:
    """Return the line on a log that was judged, or on one that could not be read."""
    if isinstance(outcome, MavhumsError):
        return LogLine(log, None, outcome.problem.removeprefix(f"{log}: "), ExitCode.ERROR)
    brief = headline(outcome)
    return LogLine(log, brief.mark, brief.text, outcome.exit_code)


def many(lines: Sequence[LogLine]) -> TableBlock:
    """Return a table of many logs, worst first, in which logs of like gravity keep their order."""
    names = [line.log.name for line in lines]
    rows: list[list[Cell]] = [
        [
            line.log.name if names.count(line.log.name) == 1 else str(line.log),
            "unreadable" if line.worst is None else [line.worst],
            line.what,
            str(int(line.code)),
        ]
        for line in sorted(lines, key=_place)
    ]
    columns = (Column("log"), Column("worst", "word"), Column("what"), Column("exit", "figure"))
    return TableBlock("", columns, rows)


def _place(line: LogLine) -> tuple[int, int]:
    return GRAVEST_FIRST.index(line.code), -URGENCY[line.worst.condition if line.worst else "undecided"]
