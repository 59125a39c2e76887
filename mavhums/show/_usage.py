"""The use of a vehicle's servos in words, for terminal, inspection and report."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mavhums.core.text import printable
from mavhums.report.usage import OutputUsage, VehicleUsage
from mavhums.show._words import clock, join, percent

__all__ = ["HEAD", "lines", "rows", "title"]

HEAD = ("output", "span", "total travel", "reversals", "at its stops", "mean (trim)")


def title(usage: VehicleUsage, *, several: bool) -> str:
    """Return who flew for how long.

    Examples
    --------
    >>> flown = {"kind": "fixed wing", "firmware": "PX4", "armed_s": 90.0, "forward_s": 75.0}
    >>> title(VehicleUsage(vehicle=1, outputs=(), **flown), several=False)
    'Usage: fixed wing, PX4; armed 1m30s, forward flight 1m15s'
    """
    who = ", ".join(printable(told) for told in (usage.kind, usage.firmware) if told)
    armed = "arming not recorded" if usage.armed_s is None else f"armed {clock(usage.armed_s)}"
    times = [armed, *([f"forward flight {clock(usage.forward_s)}"] if usage.forward_s else [])]
    vehicle = f" of vehicle {usage.vehicle}" if several else ""
    return f"Usage{vehicle}: {'; '.join(filter(None, (who, ', '.join(times))))}"


def lines(usage: VehicleUsage) -> Iterator[str]:
    """Yield a line for each surface, or where none is known for each output that moved."""
    moved, idle = _sorted(usage)
    for output in moved:
        _, span, travelled, reversals, stops, mean = _row(output)
        reversed_ = f"{reversals} {'reversal' if reversals == '1' else 'reversals'}"
        ends = "" if stops == "—" else f", {stops} at its stops"
        yield (f"{_name(output)}: span {span}, total travel {travelled}, {reversed_}{ends}, mean {mean}")
    if idle:
        yield f"never commanded: {join(map(_name, idle))}"


def rows(usage: VehicleUsage) -> Iterator[tuple[str, ...]]:
    """Yield the cells of a table under :data:`HEAD`."""
    moved, idle = _sorted(usage)
    yield from map(_row, moved)
    yield from ((_name(output), "never commanded", *["—"] * (len(HEAD) - 2)) for output in idle)


def _sorted(usage: VehicleUsage) -> tuple[list[OutputUsage], list[OutputUsage]]:
    """Return the outputs that moved, and the surfaces that never did."""
    named = [output for output in usage.outputs if output.name]
    shown: Iterable[OutputUsage] = named or usage.outputs
    return [o for o in shown if o.commanded], [o for o in named if not o.commanded]


def _name(output: OutputUsage) -> str:
    servo = f"servo {output.servo}" + (", inferred" if output.named_by == "inferred" else "")
    return f"{printable(output.name)} ({servo})" if output.name else servo


def _row(output: OutputUsage) -> tuple[str, ...]:
    span = f"{(output.greatest_us or 0) - (output.least_us or 0)} µs"
    travelled = f"{output.travelled_us} µs"
    stops, mean = "—", "—"
    if output.span is not None and output.travelled is not None:
        span, travelled = f"{percent(output.span)} of the range", f"{output.travelled:.1f} × the range"
    if output.at_low_s is not None and output.at_high_s is not None and output.held_s:
        stops = percent((output.at_low_s + output.at_high_s) / output.held_s)
    if output.mean_us is not None:
        mean = f"{output.mean_us:.0f} µs" + (f" (trim {output.range_us[1]} µs)" if output.range_us else "")
    return _name(output), span, travelled, str(output.reversals), stops, mean
