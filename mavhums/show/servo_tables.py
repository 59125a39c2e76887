"""Tables on the servos beside their condition: what torque was left, and how much they were used."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from mavhums.core.output import printable
from mavhums.results.assessment import Assessment
from mavhums.results.sections import OutputUsage, VehicleUsage
from mavhums.results.verdict import STALL_SHARES
from mavhums.show.words import clock, join, name, percent, place_of

_FRICTION, _TORQUE = STALL_SHARES


class ServoTable(NamedTuple):
    """A table with its title, and the same content in a line each."""

    title: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]
    lines: list[str]


def reserve(assessment: Assessment) -> ServoTable | None:
    """Return what torque each actuator had left, as far as its share of stall is known; None if of none."""
    rows: list[tuple[str, ...]] = []
    lines = []
    for verdict in assessment.ranked():
        shown = {one.fault: one.value for one in verdict.indicators}
        torque, rubs = shown.get(_TORQUE), shown.get(_FRICTION)
        if torque is None:
            continue
        friction = (
            f"{100 * rubs.estimate:.1f} % ({100 * rubs.low:.1f} to {100 * rubs.high:.1f})" if rubs else ""
        )
        highest, left = percent(torque.estimate), percent(max(1.0 - torque.estimate, 0.0))
        actuator = name(verdict, assessment)
        rows.append((actuator, highest, left, friction or "—"))
        end = f", friction {friction}" if friction else ""
        lines.append(f"{actuator}: highest sustained {highest}, reserve {left}{end}")
    head = ("actuator", "highest sustained", "reserve", "friction (95 %)")
    return ServoTable("Torque, by that at stall", head, rows, lines) if rows else None


def usage(used: VehicleUsage, *, several: bool) -> ServoTable:
    """Return the use of a vehicle's servos: each surface, or where none is known each output that moved.

    Examples
    --------
    >>> flown = {"kind": "fixed wing", "firmware": "PX4", "armed_s": 90.0, "forward_s": 75.0}
    >>> usage(VehicleUsage(vehicle=1, outputs=(), **flown), several=False).title
    'Usage: fixed wing, PX4; armed 1m30s, forward flight 1m15s'
    """
    who = ", ".join(printable(words) for words in (used.kind, used.firmware) if words)
    armed = "armed time not recorded" if used.armed_s is None else f"armed {clock(used.armed_s)}"
    motion = "driven forward" if used.kind in ("ground rover", "surface boat") else "forward flight"
    times = [armed, *([f"{motion} {clock(used.forward_s)}"] if used.forward_s else [])]
    vehicle = f" of vehicle {used.vehicle}" if several else ""
    title = f"Usage{vehicle}: {'; '.join(filter(None, (who, ', '.join(times))))}"
    if motors := [output for output in used.outputs if output.bearing_deg is not None]:
        return _of_motors(title, motors)
    named = [output for output in used.outputs if output.name]
    shown: Iterable[OutputUsage] = named or used.outputs
    moved, idle = [_row(o) for o in shown if o.commanded], [_name(o) for o in named if not o.commanded]
    lines = []
    for surface, span, travelled, reversals, stops, mean in moved:
        reversed_ = f"{reversals} {'reversal' if reversals == '1' else 'reversals'}"
        ends = "" if stops == "—" else f", {stops} at its stops"
        lines.append(f"{surface}: span {span}, total travel {travelled}, {reversed_}{ends}, mean {mean}")
    if idle:
        lines.append(f"never commanded: {join(idle)}")
    head = ("output", "span", "total travel", "reversals", "at its stops", "mean (trim)")
    never = [(surface, "never commanded", *["—"] * (len(head) - 2)) for surface in idle]
    return ServoTable(title, head, [*moved, *never], lines)


def _of_motors(title: str, motors: Iterable[OutputUsage]) -> ServoTable:
    """Return the use of a multirotor's motors, as shares of the range between idle and full output."""
    rows: list[tuple[str, ...]] = []
    for output in motors:
        low, _, high = output.range_us or (0, 0, 0)
        values = (output.mean_us, output.greatest_us)
        known = output.commanded and high > low
        mean, highest = (
            percent(min(max((us - low) / (high - low), 0.0), 1.0)) if known and us is not None else "—"
            for us in values
        )
        full = percent(output.at_high_s / output.held_s) if output.at_high_s and output.held_s else "0 %"
        rows.append((_name(output), place_of(output.bearing_deg or 0.0), mean, highest, full))
    head = ("motor", "place", "mean output", "highest", "time at full output")
    lines = [
        f"{motor}, {place}: mean output {mean}, highest {highest}, at full output {full} of the time"
        for motor, place, mean, highest, full in rows
    ]
    return ServoTable(title, head, rows, lines)


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
