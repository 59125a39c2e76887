"""Inspection of a log for the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from mavhums.core.text import printable
from mavhums.report.inspection import Inspection, VehicleTelemetry
from mavhums.show import _usage
from mavhums.show._words import join
from mavhums.show._words import losses as told_losses

__all__ = ["render_inspection"]

_MOST_NAMED = 100


def render_inspection(inspection: Inspection, console: Console) -> None:
    """Print an inspection: the vehicles' actuators first, then messages, then losses."""
    size = f"{inspection.size_bytes / 1e6:.2f} MB"
    start = inspection.start_utc
    when = f"from {start[:19].replace('T', ' ')} UTC" if start else "without a date"
    header = f"{inspection.path}  {size}, {inspection.duration_s:.1f} s {when}"
    console.print(printable(header), markup=False, highlight=False, soft_wrap=True)
    if not inspection.vehicles:
        console.print("\nNo vehicle speaks in this log: ground station or other traffic only.")
    for vehicle in inspection.vehicles:
        _vehicle(vehicle, console)
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("sender")
    table.add_column("message")
    table.add_column("count", justify="right")
    table.add_column("per second", justify="right")
    for row in inspection.messages:
        table.add_row(f"{row.system}/{row.component}", row.name, f"{row.count:,}", f"{row.rate_hz:.2f}")
    console.print()
    console.print(table)
    if inspection.named:
        _named(inspection, console)
    if inspection.unknown_ids:
        frames = sum(inspection.unknown_ids.values())
        ids = ", ".join(str(number) for number in sorted(inspection.unknown_ids)[:8])
        console.print(f"\n{frames} frames of messages that the dialect does not define: ids {ids}")
    _losses(inspection, console)


def _named(inspection: Inspection, console: Console) -> None:
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("vehicle", justify="right")
    table.add_column("named value")
    table.add_column("message")
    table.add_column("count", justify="right")
    table.add_column("per second", justify="right")
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
        console.print(Padding(Text(printable(line)), (0, 0, 0, 2), expand=False))
    if vehicle.usage:
        console.print(Padding(Text(_usage.title(vehicle.usage, several=False)), (0, 0, 0, 2), expand=False))
        for line in _usage.lines(vehicle.usage):
            console.print(Padding(Text(printable(line)), (0, 0, 0, 4), expand=False))


def _lines(vehicle: VehicleTelemetry) -> Iterator[str]:
    """Yield what can be judged, then once for each reason what cannot, then the sources by actuator."""
    refused: dict[tuple[str, str], list[str]] = {}
    for one in vehicle.subjects:
        moved = "roll, pitch and yaw" if one.name == "axes" else one.name
        title = f"{moved} control" if one.subject == "axis" else one.name
        if one.judgeable:
            by = f", moved by {join(one.surfaces)}" if one.surfaces else ""
            what = "control effectiveness" if one.subject == "axis" else "wear"
            yield f"{title}: {what} can be judged{by}"
        elif one.subject == "axis":
            refused.setdefault((one.reason or "", one.remedy or ""), []).append(title)
    for (reason, remedy), titles in refused.items():
        yield f"{join(titles)}: cannot be judged: {reason}; remedy: {remedy}"
    if not vehicle.judged:
        yield ": ".join(filter(None, ("wear of the servos", "cannot be judged", vehicle.remedy)))
    elif vehicle.remedy:
        yield f"remedy: {vehicle.remedy}"
    nothing = "nothing without travel_deg" if "travel_deg" in (vehicle.remedy or "") else "no telemetry"
    for actuator in vehicle.actuators:
        sources = _shorten(actuator.provenance) or nothing
        missing = f"; missing {', '.join(actuator.missing)}" if actuator.missing else ""
        yield f"{actuator.actuator} (servo {actuator.servo}): {sources}{missing}"


def _who(vehicle: VehicleTelemetry) -> str:
    told = (vehicle.kind, vehicle.firmware or vehicle.autopilot, vehicle.board and f"board {vehicle.board}")
    names = ", ".join(printable(name) for name in told if name)
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
    console.print(f"\nLog losses: {told_losses(losses)}.", highlight=False)
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
