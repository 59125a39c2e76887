"""The blocks of an assessment, once for every renderer."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Final

from mavhums.core.about import __version__
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.results.assessment import Assessment
from mavhums.results.sections import NOT_COMPARED
from mavhums.results.verdict import Verdict
from mavhums.show.blocks import Block, Craft, Curves, Finding, Headline, Listing, Note
from mavhums.show.event_words import event_lines, foremost, gravest_event
from mavhums.show.headline import advice, headline, judged_vehicles, over_flights, remedy
from mavhums.show.outline import FIXED_WING, motors, multirotor, outline, surfaces
from mavhums.show.tables import ALL_ROWS, ROWS, indicators, provenance, usage, verdict_table
from mavhums.show.verdict_words import explanation, finding, implausible, network_sentence
from mavhums.show.words import (
    TOKEN,
    capital,
    clock,
    flight_notes,
    grave_losses,
    join,
    losses,
    merged,
    moment,
    name,
    names,
    percent,
)

if TYPE_CHECKING:
    from mavhums.show.curves import EvidenceCollector

_LATEST: Final = (2, 1)  # findings of a short answer: of the gravest subject, of each other one
_FOUND: Final = 2  # findings that a short answer has; of the others it has the names
_UNKNOWN: Final = 2  # reasons of a short answer why something is not judged; none beside what is wrong
_FIRST, _LAST = 20, 20  # findings of a full one
_LINE: Final = 100  # letters of a note that a short answer has whole
_PROOF: Final = 2  # curves of what is wrong that come before the tables
_VEHICLES: Final = 8
_OPEN: Final[tuple[Condition, ...]] = ("changed", "learning", "unchanged", "normal", "undecided")
_NOT_NORMAL: Final = ("Over the flights", "Values in doubt")
_HOW_TO_READ: Final = (
    "Dashed: what the line is compared with. Dotted: since when. Shaded: 95 % interval; grey: where the "
    "reference was learned. Below: flight modes, and strokes where something happened."
)


def blocks(
    assessment: Assessment, *, brief: bool = False, gathered: EvidenceCollector | None = None
) -> list[Block]:
    """Return what is shown of an assessment.

    Parameters
    ----------
    assessment
        The verdicts of one log.
    brief
        Only what fits a screen: of several reasons the one that binds, of findings the latest; no tables
        but that of the verdicts.
    gathered
        What the engine reported of the same log, for curves, the outline, and the vehicle's texts; None
        without them.
    """
    rest, without_wings = judged_vehicles(assessment)
    # Where no vehicle is judged, the headline has the lines on them.
    first = [f"{line}." for line in without_wings] if rest.verdicts else []
    faulty = [verdict for verdict in rest.ranked() if verdict.worst in ("degraded", "emergency")]
    # What another finding explains comes after it.
    faulty.sort(key=lambda verdict: verdict.consequence_of is not None)
    head = headline(assessment)
    found = [
        *(_faulty(one, rest, _LATEST[one is not faulty[0]] if brief else None) for one in faulty[:ROWS]),
        *(one for condition in _OPEN for one in by_reason(rest, condition, brief=brief)),
    ]
    if faulty:
        found = [one._replace(todo="" if one.todo in head.todo else one.todo) for one in found]
    if brief:
        # A remedy comes once, after all that it is for.
        later = [{other.todo for other in found[k + 1 :]} for k in range(len(found))]
        found = [
            one._replace(todo="" if one.todo in those else one.todo)
            for one, those in zip(found, later, strict=True)
        ]
    over = [
        *_listing("Over the flights", over_flights(rest)),
        *_listing("Values in doubt", _once(rest.ranked(), implausible, rest)),
        *_listing("Physics and network", _once(rest.ranked(), network_sentence, rest)),
    ]
    if brief:
        middle = [*_notes([*first, *_happened(assessment)]), *verdict_table(rest, brief=True)]
        unknown = [one for one in found if one.condition in ("undecided", "learning")]
        unsaid = unknown[0 if faulty else _UNKNOWN :]
        found = [one for one in found if one not in unsaid]
        also = [f"{one.title} {one.condition}" for one in found[_FOUND:]]
        left = [f"Also: {join(also)}"] if also else []
        left += [f"Not judged: {join(one.title for one in unsaid)}"] if unsaid else []
        return [
            *_headed(head, middle, found[:_FOUND], happened=gravest_event(assessment) is not None),
            *_notes([f"{line} (--verbose has why)." for line in left]),
            *over,
            _end_of_brief(assessment),
        ]
    proof, more = _curves(rest, gathered, faulty=bool(faulty))
    well = [one for one in rest.ranked() if one not in faulty and one.coverage.windows][:ROWS]
    return [
        head._replace(about=_about(assessment)),
        *_notes(
            [
                *(f"{capital(said)}." for said in assessment.log.notices if said.startswith(NOT_COMPARED)),
                *first,
            ]
        ),
        *proof,
        *verdict_table(rest, brief=False),
        *found,
        *by_reason(rest, "unmonitored"),
        *over,
        *(_crafts(rest) if gathered is not None else ()),
        *_listing("Suspected and refuted", _once(well, _refuted, rest)),
        *more,
        *(usage(used, several=len(rest.usage) > 1) for used in rest.usage),
        *_listing("Events of the flight", event_lines(assessment)),
        _log(assessment),
        *_texts(gathered),
        *([origins] if (origins := provenance(rest)) else []),
        Note([f"mavhums {__version__}. {capital(assessment.notice)}."], quiet=True),
    ]


def _refuted(verdict: Verdict) -> str:
    """Return what was suspected of a motor without a fault, and refuted."""
    return "; ".join(map(finding, verdict.evidence if verdict.subject == "motor" else ()))


def _about(assessment: Assessment) -> str:
    log = assessment.log
    date = moment(log.start_utc) if log.start_utc else "date not known"
    return " · ".join((_file(assessment), date, clock(log.duration_s), assessment.notice))


def _notes(lines: Sequence[str]) -> list[Block]:
    return [Note(lines)] if lines else []


def _listing(title: str, lines: Iterable[str]) -> list[Block]:
    """Return lines under a title; nothing where there are none."""
    kept = [*lines]
    return [Listing(title, kept)] if kept else []


def _headed(
    head: Headline, middle: Sequence[Block], found: Sequence[Finding], *, happened: bool
) -> Iterator[Block]:
    """Yield a short answer from its headline to its findings; what the headline says is not said again.

    ``happened`` is whether the headline names an event, which has something to do of its own.
    """
    said = [one for one in found if one.why and one.why[0] in head.text]
    faulty = head.condition is not None and SEVERITY[head.condition] > SEVERITY["normal"] and not head.word
    yield head._replace(todo=head.todo if faulty or happened else said[0].todo if said else "")
    yield from middle
    # The headline of an event has no room for what is to be done about what was not judged.
    yield from (one for one in found if one not in said or (happened and one.todo and not faulty))


def _happened(assessment: Assessment) -> list[str]:
    """Return what happened and is not ordinary, in one sentence."""
    lines = foremost(assessment)
    return [f"Events: {'; '.join(lines)}."] if lines else []


def _file(assessment: Assessment) -> str:
    """Return the log's name; whoever gets a report learns nothing of its sender's disk."""
    path = assessment.log.path
    return PurePath(path.replace("\\", "/")).name if path else "a live link"


def _texts(gathered: EvidenceCollector | None) -> list[Block]:
    """Return the texts from the vehicle."""
    texts = gathered.notices() if gathered is not None else []
    more = gathered is not None and gathered.texts > len(texts)
    left_out = f", {len(texts)} of {gathered.texts}: the first and the last ones" if gathered and more else ""
    lines = [f"{clock(one.time_s)} {one.text}" for one in texts]
    return _listing(f"Texts from the vehicle{left_out}", lines)


def _end_of_brief(assessment: Assessment) -> Note:
    """Return the end of a short answer: whose flight it is, and losses that matter."""
    lost = grave_losses(assessment.log.losses)
    notes = flight_notes(assessment)
    said = [note if len(note) <= _LINE else note.partition("; ")[0] for note in notes]
    said += [f"Log losses: {join(lost)}"] if lost else []
    said += [capital(assessment.notice.partition(";")[0]), "--verbose shows all."]
    return Note([". ".join(said)], quiet=True)


def not_normal(assessment: Assessment) -> list[Block]:
    """Return of a short answer what is not normal: headline and findings, and what is so over the flights."""
    return [one for one in blocks(assessment, brief=True) if _is_not_normal(one)]


def _is_not_normal(block: Block) -> bool:
    if isinstance(block, Headline):
        return block.condition not in ("normal", "unchanged", "unmonitored")
    return isinstance(block, Finding) or (isinstance(block, Listing) and block.title in _NOT_NORMAL)


def _faulty(verdict: Verdict, assessment: Assessment, latest: int | None) -> Finding:
    """Return what is or was wrong with a subject; in short with so many of the ``latest`` findings."""
    why = [finding(item) for item in verdict.evidence]
    if latest and len(why) > latest:
        # The latest findings say what is so now, and why.
        why[:-latest] = [f"… {len(why) - latest} earlier"][: latest - 1]
    elif len(why) > _FIRST + _LAST + 1:
        why[_FIRST:-_LAST] = [f"… {len(why) - _FIRST - _LAST} more findings ({ALL_ROWS})"]
    explained = explanation(verdict)
    title, todo = name(verdict, assessment), advice(verdict)
    if latest and verdict.consequence_of and explained:
        return Finding(title, verdict.worst, [explained])
    if latest:
        return Finding(title, verdict.worst, [*why, *([explained] if explained else [])], todo)
    since = verdict.since
    when = f"{clock(since.flight_time_s)} into the log ({moment(since.utc)})" if since else ""
    now = f"{verdict.condition} {f'since {when}' if when else 'at the end'}; the earlier finding holds"
    suspects = [f"{item.fault.replace('_', ' ')} ({percent(item.confidence)})" for item in verdict.suspects]
    facts = {
        "Since": when if verdict.condition == verdict.worst else "",
        "Now": now if verdict.condition != verdict.worst else "",
        "Reason": verdict.reason,
        "Which surface": explained,
        "Suspected": join(suspects) if suspects else "",
    }
    shown = [f"{name}: {value}" for name, value in facts.items() if value]
    return Finding(title, verdict.worst, why, todo, shown, indicators(verdict.indicators))


def by_reason(assessment: Assessment, condition: Condition, *, brief: bool = False) -> Iterator[Finding]:
    """Yield the verdicts of a condition by reason and remedy, so that neither is said twice.

    A short answer has of several reasons the first one, which binds, and its remedy once for all that follow.
    """
    groups: dict[tuple[object, ...], list[tuple[Verdict, str, str]]] = {}
    for verdict in assessment.verdicts:
        if brief and condition == "normal" and verdict.coverage.excluded_loss is not None:
            continue  # the headline has the bound
        if brief and SEVERITY[verdict.gravest] > SEVERITY["normal"]:
            continue  # what is wrong with it comes first, what is unknown by now with all else
        if verdict.condition == condition and (verdict.reason or condition != "normal"):
            why, todo = (verdict.reason or "no reason was given").rstrip("."), remedy(verdict)
            if brief:
                why, todo = why.partition("; ")[0], todo.partition("; ")[0]
                todo = "" if condition == "normal" else todo
            alike = (verdict.reason_codes[:1] if brief else verdict.reason_codes) or why
            key = (alike, *(len(TOKEN.findall(text)) for text in (why, todo)))
            groups.setdefault(key, []).append((verdict, why, todo))
    for own in groups.values():
        verdicts, whys, todos = zip(*own, strict=True)
        why, todo = merged(whys), merged(todos)
        reasons = {one for each in verdicts for one in (each.reason or why).rstrip(".").split("; ")[1:]}
        more = f" (and {len(reasons)} more: --verbose)" if brief and reasons else ""
        yield Finding(names(verdicts, assessment), condition, [f"{why}{more}"], todo)


def _once(
    verdicts: Iterable[Verdict], said_of: Callable[[Verdict], str | None], assessment: Assessment
) -> Iterator[str]:
    """Yield what is said of verdicts, once for all of which the same is said."""
    alike: dict[str, list[Verdict]] = {}
    for verdict in verdicts:
        if sentence := said_of(verdict):
            alike.setdefault(sentence, []).append(verdict)
    yield from (f"{names(own, assessment)}: {sentence}" for sentence, own in alike.items())


def _curves(
    assessment: Assessment, gathered: EvidenceCollector | None, *, faulty: bool
) -> tuple[list[Block], list[Block]]:
    """Return the curves that come before the tables, where something is wrong, and the others."""
    if gathered is None:
        return [], []
    from mavhums.show.evidence import evidence

    curves, proof = [*evidence(assessment, gathered)], _PROOF if faulty else 0
    titles = ("Evidence", "More evidence" if faulty else "Evidence over the flight")
    first, more = (
        [Curves(title, _HOW_TO_READ, part, assessment.log.duration_s)] if part else []
        for title, part in zip(titles, (curves[:proof], curves[proof:]), strict=True)
    )
    return [*first], [*more]


def _crafts(assessment: Assessment) -> Iterator[Craft]:
    """Yield the outline of each vehicle whose parts are known, the first eight."""
    vehicles = dict.fromkeys(verdict.vehicle for verdict in assessment.verdicts)
    for vehicle in list(vehicles)[:_VEHICLES]:
        if bearings := motors(assessment, vehicle):
            own = [verdict for verdict in assessment.verdicts if verdict.vehicle == vehicle]
            parts, body = multirotor(bearings, own)
        else:
            parts, body = outline(surfaces(assessment, vehicle)), FIXED_WING
        if parts:
            title = f"Vehicle {vehicle}" if len(vehicles) > 1 else "The aircraft from above"
            yield Craft(title, parts, body)


def _log(assessment: Assessment) -> Listing:
    log = assessment.log
    lines = [
        f"File: {_file(assessment)} ({log.format or 'format not known'})",
        f"Start: {moment(log.start_utc) if log.start_utc else 'not known'}",
        f"Duration: {clock(log.duration_s)}",
        f"Losses: {losses(log.losses)}",
        *(f"Flight: {note}" for note in flight_notes(assessment)),
    ]
    for flight in log.flight[: 2 * _VEHICLES]:
        vehicle = f"Vehicle {flight.vehicle}" if flight.vehicle is not None else "Vehicle"
        switched_on = moment(flight.boot_utc) if flight.boot_utc else "at a time not known"
        lines.append(f"{vehicle}: board {flight.board or 'not known'}; switched on {switched_on}")
    return Listing(
        "The log",
        [
            *lines,
            f"Airframe: {assessment.airframe or 'none named'}",
            f"Network: {assessment.model.name if assessment.model else 'none'}",
            f"SHA-256: {log.sha256 or 'not known'}",
        ],
    )
