"""What a log holds, on the terminal."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from mavhums.inspection import Inspection, VehicleTelemetry

__all__ = ["render_inspection"]


def render_inspection(inspection: Inspection, console: Console) -> None:
    """Print an inspection: the vehicles' actuators first, then the messages, then what was lost."""
    size = f"{inspection.size_bytes / 1e6:.2f} MB"
    start = inspection.start_utc[:19].replace("T", " ") + " UTC" if inspection.start_utc else "no message"
    header = f"{inspection.path}  {size}, {inspection.duration_s:.1f} s from {start}"
    console.print(header, markup=False, highlight=False, soft_wrap=True)
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
    if inspection.unknown_ids:
        frames = sum(inspection.unknown_ids.values())
        ids = ", ".join(str(number) for number in sorted(inspection.unknown_ids)[:8])
        console.print(f"\n{frames} frames of messages that the dialect does not define: ids {ids}")
    _losses(inspection, console)


def _vehicle(vehicle: VehicleTelemetry, console: Console) -> None:
    airframe = vehicle.airframe or "not named"
    console.print(
        f"\n[bold]Vehicle {vehicle.vehicle}[/]: airframe {escape(airframe)}; telemetry tier "
        f"{vehicle.tier or 'none'}, which gives {vehicle.gives}",
        highlight=False,
    )
    if not vehicle.judged:
        console.print("  Health cannot be judged from this log.", highlight=False)
    if vehicle.remedy:
        console.print(f"  Remedy: {escape(vehicle.remedy)}", highlight=False)
    for actuator in vehicle.actuators:
        sources = _shorten(actuator.provenance)
        missing = f"; missing {', '.join(actuator.missing)}" if actuator.missing else ""
        console.print(
            f"  {actuator.actuator} (servo {actuator.servo}): {sources}{missing}",
            markup=False,
            highlight=False,
        )


def _shorten(provenance: dict[str, str]) -> str:
    """Name each source once, with the range of quantities that come from it."""
    by_source: dict[str, list[str]] = {}
    for key, source in provenance.items():
        by_source.setdefault(source.split(".")[0], []).append(key)
    parts = []
    for source, keys in by_source.items():
        named = f"{keys[0]}–{keys[-1]}" if len(keys) > 2 and _consecutive(keys) else ", ".join(keys)
        parts.append(f"{named} from {source}")
    return "; ".join(parts) or "no telemetry"


def _consecutive(keys: list[str]) -> bool:
    numbers = [int(key[1:]) for key in keys]
    return numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def _losses(inspection: Inspection, console: Console) -> None:
    losses = inspection.losses
    if not losses.any:
        console.print("\nNothing was lost.")
        return
    parts = []
    if losses.bytes_skipped:
        parts.append(f"{losses.bytes_skipped:,} bytes skipped in {losses.damaged_regions:,} places")
    if losses.bad_crc_frames:
        parts.append(f"{losses.bad_crc_frames:,} frames with a bad CRC")
    if losses.implausible_times:
        parts.append(f"{losses.implausible_times:,} implausible time stamps")
    if losses.cut_end_bytes:
        parts.append(f"{losses.cut_end_bytes:,} bytes of an unfinished record at the end")
    console.print(f"\nLost: {', '.join(parts)}.", highlight=False)
