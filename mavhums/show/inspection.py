"""Inspection of a log for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from mavhums.actuator.telemetry import TO_BE_JUDGED
from mavhums.core.output import printable
from mavhums.health.verdict.obstacles import NO_WINGS, PROPELLERS_ONLY
from mavhums.results.assessment import Inspection, Judgeable, VehicleTelemetry
from mavhums.show.digest import NOT_JUDGED
from mavhums.show.servo_tables import usage
from mavhums.show.terminal import indented
from mavhums.show.words import join
from mavhums.show.words import losses as loss_words

_MOST_NAMED = 100
_NAMED_SUBJECTS = 3
_NOTHING_REPORTED = (PROPELLERS_ONLY, TO_BE_JUDGED)


def render_inspection(inspection: Inspection, console: Console, *, messages: bool = False) -> None:
    """Print an inspection: what can be judged, the vehicles' actuators, then losses.

    Parameters
    ----------
    inspection
        The contents of a log.
    console
        Where to print.
    messages
        Whether to list the messages and the named values.
    """
    console.print(Text(printable(_verdict(inspection)), style="bold"))
    size = f"{inspection.size_bytes / 1e6:.2f} MB"
    start = inspection.start_utc
    when = f"from {start[:19].replace('T', ' ')} UTC" if start else "without a date"
    header = f"{inspection.path}  {size}, {inspection.duration_s:.1f} s {when}"
    console.print(printable(header), markup=False, highlight=False, soft_wrap=True)
    for vehicle in inspection.vehicles:
        _vehicle(vehicle, console)
    if messages:
        _messages(inspection, console)
        if inspection.named:
            _named(inspection, console)
    else:
        console.print(f"\n{_counted(inspection)}; --messages lists them", highlight=False)
    if inspection.unknown_ids:
        frames = sum(inspection.unknown_ids.values())
        ids = ", ".join(str(number) for number in sorted(inspection.unknown_ids)[:8])
        console.print(f"\n{frames} frames of messages that the dialect does not define: ids {ids}")
    _losses(inspection, console)


def _verdict(inspection: Inspection) -> str:
    """Return in one line what the log allows to judge."""
    if not inspection.vehicles:
        return "Nothing can be judged: no vehicle speaks in this log, ground station or other traffic only"
    several = len(inspection.vehicles) > 1
    parts = []
    for vehicle in inspection.vehicles:
        text = _wingless(vehicle) or _what(vehicle.subjects)
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
    axes = [_title(one) for one in subjects if one.subject == "axis"]
    motors = [one.name for one in subjects if one.subject == "motor"]
    return [*axes, *motors, *([f"wear of {named}"] if servos else [])]


def _wingless(vehicle: VehicleTelemetry) -> str | None:
    """Return what is said of a vehicle without wings and servos that report; None of any other."""
    axes = next((one for one in vehicle.subjects if one.remedy == NO_WINGS), None)
    servos = [one for one in vehicle.subjects if one is not axes]
    if axes is None or any(one.judgeable or one.remedy not in _NOTHING_REPORTED for one in servos):
        return None
    return f"{(axes.reason or '').partition(':')[0]}: {NOT_JUDGED}"


def _title(one: Judgeable) -> str:
    return f"{'roll, pitch and yaw' if one.name == 'axes' else one.name} control"


def _counted(inspection: Inspection) -> str:
    kinds, senders = len(inspection.messages), {(row.system, row.component) for row in inspection.messages}
    count = sum(row.count for row in inspection.messages)
    by = f"{len(senders)} {'sender' if len(senders) == 1 else 'senders'}"
    return f"{count:,} messages of {kinds} {'kind' if kinds == 1 else 'kinds'} by {by}"


def _messages(inspection: Inspection, console: Console) -> None:
    table = _counts("sender", "message")
    for row in inspection.messages:
        table.add_row(f"{row.system}/{row.component}", row.name, f"{row.count:,}", f"{row.rate_hz:.2f}")
    console.print()
    console.print(table)


def _counts(*headings: str) -> Table:
    """Return a table with a count and a rate in each row."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in headings:
        table.add_column(heading)
    table.add_column("count", justify="right")
    table.add_column("per second", justify="right")
    return table


def _named(inspection: Inspection, console: Console) -> None:
    table = _counts("vehicle", "named value", "message")
    for row in inspection.named[:_MOST_NAMED]:
        name = escape(printable(row.name))
        table.add_row(str(row.system), name, row.message, f"{row.count:,}", f"{row.rate_hz:.2f}")
    console.print()
    console.print(table)
    if len(inspection.named) > _MOST_NAMED:
        console.print(f"… and {len(inspection.named) - _MOST_NAMED} more names, which --json lists")


def _vehicle(vehicle: VehicleTelemetry, console: Console) -> None:
    airframe = printable(vehicle.airframe or "not named")
    console.print(
        f"\n[bold]Vehicle {vehicle.vehicle}[/]{escape(_who(vehicle))}: airframe {escape(airframe)}; "
        f"telemetry tier {vehicle.tier or 'none'}, which gives {vehicle.gives}",
        highlight=False,
    )
    for line in _lines(vehicle):
        console.print(indented(line.lstrip(), 2 + len(line) - len(line.lstrip())))
    if vehicle.usage and not _wingless(vehicle):
        used = usage(vehicle.usage, several=False)
        console.print(indented(used.title))
        for line in used.lines:
            console.print(indented(line, 4))


def _lines(vehicle: VehicleTelemetry) -> Iterator[str]:
    """Yield what can be judged, then once for each reason what cannot, then the sources by actuator."""
    refused: dict[tuple[str, str], list[Judgeable]] = {}
    for one in () if _wingless(vehicle) else vehicle.subjects:
        if one.judgeable and one.subject == "axis":
            by = f", moved by {join(one.surfaces)}" if one.surfaces else ""
            yield f"{_title(one)}: control effectiveness can be judged{by}"
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
    nothing = "nothing without travel_deg" if "travel_deg" in (vehicle.remedy or "") else "no telemetry"
    for actuator in vehicle.actuators:
        sources = _shorten(actuator.provenance) or nothing
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


def _losses(inspection: Inspection, console: Console) -> None:
    losses = inspection.losses
    for note in _notes(inspection):
        console.print(f"\n{note}", highlight=False, markup=False)
    console.print(f"\nLog losses: {loss_words(losses)}.", highlight=False)
    if losses.bad_crc_frames:
        console.print(f"  wrong checksums: {_ranked(losses.bad_crc_by_message)}", highlight=False)
    if losses.regions:
        shown = ", ".join(f"{region.offset:,}+{region.size:,}" for region in losses.regions[:5])
        more = ", …" if losses.damaged_regions > 5 else ""
        console.print(f"  skipped at byte (offset+size): {shown}{more}", highlight=False)
    if losses.padded_frames:
        console.print(
            f"\nIn doubt: {losses.padded_frames:,} frames whose zeros were trimmed after the CRC "
            "was computed, accepted with the zeros put back; "
            f"at most {losses.padded_false_bound:.2g} of them by chance.",
            highlight=False,
        )


def _notes(inspection: Inspection) -> Iterator[str]:
    """Yield notes on the log as a whole, and on losses on the link."""
    losses = inspection.losses
    if inspection.sender_clock:
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


def _ranked(counts: dict[str, int]) -> str:
    ranked = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    more = ", …" if len(ranked) > 4 else ""
    return ", ".join(f"{name} {count:,}" for name, count in ranked[:4]) + more
