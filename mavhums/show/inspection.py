"""The blocks of what is inside: of a log that is inspected, and of a model by its card."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Final

from mavhums.core.models import Contract
from mavhums.core.output import printable
from mavhums.results.assessment import Inspection, Judgeable, VehicleTelemetry
from mavhums.show.blocks import Block, Column, Headline, Listing, Note, TableBlock
from mavhums.show.headline import wingless
from mavhums.show.tables import usage
from mavhums.show.words import join, subject_of
from mavhums.show.words import losses as loss_words

if TYPE_CHECKING:
    from mavhums.learn import Model

_MOST_NAMED = 100
_NAMED_SUBJECTS = 3


def inspection_blocks(inspection: Inspection, *, messages: bool = False) -> Iterator[Block]:
    """Yield what is shown of an inspection: what can be judged, the vehicles' actuators, then losses.

    Parameters
    ----------
    inspection
        The contents of a log.
    messages
        Whether to list the messages and the named values.
    """
    yield Headline(_verdict(inspection))
    size = f"{inspection.size_bytes / 1e6:.2f} MB"
    start = inspection.start_utc
    when = f"from {start[:19].replace('T', ' ')} UTC" if start else "without a date"
    yield Note([f"{inspection.path}  {size}, {inspection.duration_s:.1f} s {when}"])
    for vehicle in inspection.vehicles:
        yield Listing(
            f"Vehicle {vehicle.vehicle}{_who(vehicle)}: airframe {vehicle.airframe or 'not named'}; "
            f"telemetry tier {vehicle.tier or 'none'}, which gives {vehicle.gives}",
            [*_lines(vehicle)],
        )
        if vehicle.usage and not wingless(vehicle.subjects):
            yield usage(vehicle.usage, several=False)
    counted = _counted(inspection)
    if messages:
        yield from _messages(inspection)
    yield Listing(
        "The log", [counted if messages else f"{counted}; --messages lists them", *_notes(inspection)]
    )


def _verdict(inspection: Inspection) -> str:
    """Return in one line what the log allows to judge."""
    if not inspection.vehicles:
        return "Nothing can be judged: no vehicle speaks in this log, ground station or other traffic only"
    several = len(inspection.vehicles) > 1
    parts = []
    for vehicle in inspection.vehicles:
        text = wingless(vehicle.subjects) or _what(vehicle.subjects)
        parts.append(f"vehicle {vehicle.vehicle}: {text}" if several else f"{text[:1].upper()}{text[1:]}")
    return "; ".join(parts)


def _what(subjects: Sequence[Judgeable]) -> str:
    good = _titles([one for one in subjects if one.judgeable])
    bad = _titles([one for one in subjects if not one.judgeable])
    if not good:
        return "nothing can be judged"
    return f"{join(good)} can be judged" + (f"; {join(bad)} cannot" if bad else "")


def _titles(subjects: Sequence[Judgeable]) -> list[str]:
    """Return the axes, and the wear of the servos as one."""
    servos = [one.name for one in subjects if one.subject == "actuator"]
    named = join(servos) if servos and len(servos) <= _NAMED_SUBJECTS else f"{len(servos)} servos"
    axes = [subject_of(one.subject, one.name) for one in subjects if one.subject == "axis"]
    motors = [one.name for one in subjects if one.subject == "motor"]
    return [*axes, *motors, *([f"wear of {named}"] if servos else [])]


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


def _lines(vehicle: VehicleTelemetry) -> Iterator[str]:
    """Yield what can be judged, then once for each reason what cannot, then the sources by actuator."""
    refused: dict[tuple[str, str], list[Judgeable]] = {}
    for one in () if wingless(vehicle.subjects) else vehicle.subjects:
        if one.judgeable and one.subject == "axis":
            by = f", moved by {join(one.surfaces)}" if one.surfaces else ""
            yield f"{subject_of(one.subject, one.name)}: control effectiveness can be judged{by}"
        elif not one.judgeable:
            refused.setdefault((one.reason or "", one.remedy or ""), []).append(one)
    if motors := [one for one in vehicle.subjects if one.judgeable and one.subject == "motor"]:
        yield f"{join(_titles(motors))}: a loss of thrust can be judged"
    if wear := [one for one in vehicle.subjects if one.judgeable and one.subject == "actuator"]:
        yield f"{join(_titles(wear))}: can be judged"
    for (reason, remedy), subjects in refused.items():
        yield f"{join(_titles(subjects))}: cannot be judged: {reason}"
        if remedy:
            yield f"  remedy: {remedy}"
    for actuator in vehicle.actuators:
        sources = _shorten(actuator.provenance) or "no telemetry"
        missing = f"; missing {', '.join(actuator.missing)}" if actuator.missing else ""
        yield f"{actuator.actuator} (servo {actuator.servo}): {sources}{missing}"


def _who(vehicle: VehicleTelemetry) -> str:
    facts = (vehicle.kind, vehicle.firmware or vehicle.autopilot, vehicle.board and f"board {vehicle.board}")
    names = ", ".join(printable(name) for name in facts if name)
    return f" ({names})" if names else ""


def _shorten(provenance: dict[str, str]) -> str:
    """Name each source once, with the range of quantities that come from it."""
    by_source: dict[str, list[str]] = {}
    for key, source in provenance.items():
        by_source.setdefault(source.split(".")[0], []).append(key)
    parts = []
    for source, keys in by_source.items():
        named = f"{keys[0]}–{keys[-1]}" if len(keys) > 2 and _consecutive(keys) else ", ".join(keys)
        parts.append(f"{named} from {source}")
    return "; ".join(parts)


def _consecutive(keys: list[str]) -> bool:
    numbers = [int(key[1:]) for key in keys]
    return numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def _notes(inspection: Inspection) -> Iterator[str]:
    """Yield notes on the log as a whole, and on its losses."""
    losses = inspection.losses
    if inspection.unknown_ids:
        frames = sum(inspection.unknown_ids.values())
        ids = ", ".join(str(number) for number in sorted(inspection.unknown_ids)[:8])
        yield f"{frames} frames of messages that the dialect does not define: ids {ids}"
    if inspection.start_utc is None:
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
    for name, group in groups.items():
        yield Listing(f"{title}: {_words(name)}", _fields(group))


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
