"""The blocks of what is inside: of a log that is inspected, and of a model by its card."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Final

from mavhums.core.models import Contract
from mavhums.core.output import printable
from mavhums.core.quantities import KEYS
from mavhums.results.assessment import Assessment, Inspection, VehicleTelemetry
from mavhums.results.verdict import Verdict
from mavhums.show.answer import by_reason
from mavhums.show.blocks import Block, Column, Headline, Listing, Note, TableBlock
from mavhums.show.headline import judged_vehicles
from mavhums.show.tables import provenance, usage
from mavhums.show.words import capital, join, moment, name, names
from mavhums.show.words import losses as loss_words

if TYPE_CHECKING:
    from mavhums.learn import Model

_MOST_NAMED = 100


def inspection_blocks(inspection: Inspection, *, messages: bool = False) -> Iterator[Block]:
    """Yield what is shown of an inspection: what can be judged, the vehicles' actuators, then losses.

    Parameters
    ----------
    inspection
        The contents of a log.
    messages
        Whether to list the messages and the named values.
    """
    assessment, log = inspection.assessment, inspection.assessment.log
    judged, without_wings = judged_vehicles(assessment)
    own = {one.vehicle: _of_vehicle(judged, one.vehicle) for one in inspection.vehicles}
    yield Headline(_verdict(own, without_wings))
    when = f"from {moment(log.start_utc)}" if log.start_utc else "without a date"
    yield Note([f"{log.path}  {inspection.size_bytes / 1e6:.2f} MB, {log.duration_s:.1f} s {when}"])
    for vehicle in inspection.vehicles:
        alone = own[vehicle.vehicle]
        title = f"Vehicle {vehicle.vehicle}{_who(vehicle)}: airframe {vehicle.airframe or 'not named'}"
        telemetry = f"telemetry tier {vehicle.tier or 'none'}, which gives {vehicle.gives}"
        yield Listing(f"{title}; {telemetry}", [*_lines(alone)])
        for condition in ("undecided", "unmonitored"):
            yield from by_reason(_of(alone, judgeable=False), condition)
        yield from (usage(used, several=False) for used in alone.usage)
    if origins := provenance(judged):
        yield origins
    counted = _counted(inspection)
    if messages:
        yield from _messages(inspection)
    yield Listing(
        "The log", [counted if messages else f"{counted}; --messages lists them", *_notes(inspection)]
    )


def _of_vehicle(assessment: Assessment, vehicle: int) -> Assessment:
    """Return what an assessment has of one vehicle."""
    verdicts = tuple(one for one in assessment.verdicts if one.vehicle == vehicle)
    used = tuple(one for one in assessment.usage if one.vehicle == vehicle)
    return assessment.model_copy(update={"verdicts": verdicts, "usage": used})


def _of(assessment: Assessment, *, judgeable: bool) -> Assessment:
    """Return the verdicts on what can be judged, or on what cannot."""
    unknown = {"undecided", "unmonitored"}
    kept = tuple(one for one in assessment.verdicts if ({one.condition, one.worst} <= unknown) != judgeable)
    return assessment.model_copy(update={"verdicts": kept})


def _verdict(own: Mapping[int, Assessment], without_wings: Sequence[str]) -> str:
    """Return in one line what the log allows to judge of each vehicle."""
    if not own:
        return "Nothing can be judged: no vehicle speaks in this log, ground station or other traffic only"
    known = {vehicle: _what(alone) for vehicle, alone in own.items() if alone.verdicts}
    several = len(own) > 1
    said = [f"vehicle {vehicle}: {text}" if several else capital(text) for vehicle, text in known.items()]
    return "; ".join([*said, *without_wings])


def _what(alone: Assessment) -> str:
    good, bad = (_titles(_of(alone, judgeable=judgeable)) for judgeable in (True, False))
    if not good:
        return "nothing can be judged"
    return f"{join(good)} can be judged" + (f"; {join(bad)} cannot" if bad else "")


def _titles(alone: Assessment) -> list[str]:
    """Return the axes, the motors, which can all be judged where one can, and the wear of the servos."""
    axes, motors, servos = (
        [one for one in alone.verdicts if one.subject == subject] for subject in ("axis", "motor", "actuator")
    )
    return [
        *([names(axes, alone)] if axes else []),
        *(["motors"] if motors else []),
        *([f"wear of {names(servos, alone)}"] if servos else []),
    ]


def _lines(alone: Assessment) -> Iterator[str]:
    """Yield what moves the axes that can be judged, and what the log lacks of each actuator."""
    for one in _of(alone, judgeable=True).verdicts:
        if one.surfaces:
            yield f"{name(one, alone)}: moved by {join(one.surfaces)}"
    lacking: dict[str, list[Verdict]] = {}
    for one in alone.verdicts:
        if one.subject == "actuator" and one.provenance:
            lacks = ", ".join(key for key in KEYS if key not in one.provenance)
            lacking.setdefault(lacks, []).append(one)
    yield from (f"{names(of, alone)}: the log lacks {lacks}" for lacks, of in lacking.items() if lacks)


def _counted(inspection: Inspection) -> str:
    kinds, senders = len(inspection.messages), {(row.system, row.component) for row in inspection.messages}
    count = sum(row.count for row in inspection.messages)
    by = f"{len(senders)} {'sender' if len(senders) == 1 else 'senders'}"
    return f"{count:,} messages of {kinds} {'kind' if kinds == 1 else 'kinds'} by {by}"


def _messages(inspection: Inspection) -> Iterator[Block]:
    counts = [Column("count", "figure"), Column("per second", "figure")]
    rows = [
        [f"{row.system}/{row.component}", row.name, f"{row.count:,}", f"{row.rate_hz:.2f}"]
        for row in inspection.messages
    ]
    yield TableBlock("Messages", [Column("sender"), Column("message"), *counts], rows)
    named = [
        [str(row.system), row.name, row.message, f"{row.count:,}", f"{row.rate_hz:.2f}"]
        for row in inspection.named[:_MOST_NAMED]
    ]
    if named:
        columns = [Column("vehicle"), Column("named value"), Column("message"), *counts]
        yield TableBlock("Named values", columns, named)
    if len(inspection.named) > _MOST_NAMED:
        yield Note([f"… and {len(inspection.named) - _MOST_NAMED} more names, which --json lists"])


def _who(vehicle: VehicleTelemetry) -> str:
    facts = (vehicle.kind, vehicle.firmware or vehicle.autopilot, vehicle.board and f"board {vehicle.board}")
    known = ", ".join(printable(fact) for fact in facts if fact)
    return f" ({known})" if known else ""


def _notes(inspection: Inspection) -> Iterator[str]:
    """Yield notes on the log as a whole, and on its losses."""
    log, losses = inspection.assessment.log, inspection.assessment.log.losses
    yield from (f"{capital(notice)}." for notice in log.notices)
    if inspection.unknown_ids:
        frames = sum(inspection.unknown_ids.values())
        ids = ", ".join(str(number) for number in sorted(inspection.unknown_ids)[:8])
        yield f"{frames} frames of messages that the dialect does not define: ids {ids}"
    if log.start_utc is None:
        yield "The log has no date: times count from the autopilot's boot."
    if losses.line_ends_restored:
        yield (
            "The log was converted to text (LF to CRLF); "
            f"that was undone in {losses.line_ends_restored:,} places."
        )
    if losses.trailing_zeros:
        yield f"{losses.trailing_zeros:,} zero bytes follow the last frame."
    if losses.time_jumps or losses.time_rewinds:
        ahead, back = losses.time_jumps, losses.time_rewinds
        yield f"The clock jumps ahead {ahead} times by over a minute, back {back} times by over a second."
    for sender in losses.sequence:
        parts = [f"{sender.missing:,} frames missing in {sender.gaps:,} gaps"] if sender.missing else []
        parts += [f"{sender.reordered:,} out of order"] if sender.reordered else []
        parts += [f"{sender.duplicated:,} twice"] if sender.duplicated else []
        if parts:
            of = f"of {sender.system}/{sender.component} ({sender.frames:,} frames)"
            yield f"Sequence numbers {of}: {', '.join(parts)}."
    yield f"Log losses: {loss_words(losses)}."
    if losses.bad_crc_frames:
        yield f"  wrong checksums: {_ranked(losses.bad_crc_by_message)}"
    if losses.regions:
        shown = ", ".join(f"{region.offset:,}+{region.size:,}" for region in losses.regions[:5])
        more = ", …" if losses.damaged_regions > 5 else ""
        yield f"  skipped at byte (offset+size): {shown}{more}"
    if losses.padded_frames:
        yield (
            f"In doubt: {losses.padded_frames:,} frames whose zeros were trimmed after the CRC "
            "was computed, accepted with the zeros put back; "
            f"at most {losses.padded_false_bound:.2g} of them by chance."
        )


def _ranked(counts: dict[str, int]) -> str:
    ranked = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    more = ", …" if len(ranked) > 4 else ""
    return ", ".join(f"{name} {count:,}" for name, count in ranked[:4]) + more


_APART: Final = ("name", "command", "selection", "calibration", "window")


def card_blocks(model: Model) -> Iterator[Block]:
    """Yield a model's purpose, training, metrics, and what each stage of the selection kept and dropped."""
    card = model.card
    hidden = {"hidden neurons": model.network.tensors["w1"].shape[1], "sha256": model.hash}
    yield from _sections(card.name, card, hidden)
    if card.calibration is not None:
        title = "Calibration of a window's votes, on flights of their own"
        formula = f"1 / (1 + exp(−({card.calibration.slope:g}·s {card.calibration.intercept:+g})))"
        yield from _sections(title, card.calibration, {"probability for a share s of votes": formula})
    yield Listing("Selection of the quantities", card.selection.stage_lines(card.features))
    if card.window is not None:
        yield from _sections("Network of windows", card.window, {})
        lines = card.window.selection.stage_lines(card.window.features)
        yield Listing("Network of windows: selection of the features", lines)


def _sections(title: str, part: Contract, more: Mapping[str, object]) -> Iterator[Listing]:
    """Yield the fields of a part of a card, then those of each group of them under its name."""
    fields = {name: getattr(part, name) for name in type(part).model_fields if name not in _APART}
    groups = {name: value for name, value in fields.items() if isinstance(value, Mapping) and value}
    single = {name: value for name, value in fields.items() if name not in groups and value not in (None, {})}
    yield Listing(title, _fields({**single, **more}))
    for field, group in groups.items():
        yield Listing(f"{title}: {_words(field)}", _fields(group))


def _fields(values: Mapping[str, object]) -> list[str]:
    return [f"{_words(name)}: {_value(value)}" for name, value in values.items()]


def _value(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{_words(name)} {_value(part)}" for name, part in value.items())
    if isinstance(value, tuple | list):
        return ", ".join(_words(_value(part)) for part in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _words(name: str) -> str:
    return name.replace("_", " ")
