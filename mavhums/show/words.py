"""Values in words: conditions and their colours, times, shares, intervals, losses, names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from math import cos, radians, sin
from typing import TYPE_CHECKING, Final

from mavhums.core.conditions import Condition
from mavhums.log.base.decoder import Losses
from mavhums.results.assessment import Assessment
from mavhums.results.sections import NOT_COMPARED, AxisLimits
from mavhums.results.standing import Standing
from mavhums.results.verdict import ALL, Interval, Verdict

if TYPE_CHECKING:
    from mavhums.results.live import LinkStatus


COLOURS: Final[dict[Condition, tuple[int, int, int]]] = {
    "normal": (0, 158, 115),
    "degraded": (230, 159, 0),
    "emergency": (213, 94, 0),
    "undecided": (153, 153, 153),
    "unmonitored": (110, 110, 116),
    "unchanged": (86, 180, 233),
    "changed": (240, 228, 66),
    "learning": (204, 121, 167),
}
"""One colour per condition, from Okabe and Ito's palette for colour-blind readers."""

SIGNS: Final[dict[Condition, str]] = {
    "normal": "✓",
    "unchanged": "=",
    "changed": "≠",
    "degraded": "▲",
    "emergency": "✖",
    "learning": "…",
    "undecided": "?",
    "unmonitored": "○",
}
"""A sign per condition, so that no reader depends on its colour."""

STALE: Final = "stale"
STALE_COLOUR: Final = (60, 60, 66)
BLUE: Final = (86, 180, 233)
PALE_BLUE: Final = (60, 110, 145)
YELLOW: Final = (240, 228, 66)
SERIES: Final = (BLUE, YELLOW, (204, 121, 167), (0, 158, 115))

_ORDER: Final = ("axis", "motor", "actuator")
_NAMED: Final = 4  # more names than that are counted
_TO_ACT_ON: Final[tuple[Condition, ...]] = ("changed", "degraded", "emergency")


def condition_word(condition: Condition) -> str:
    """Return a condition as a table shows it: what must be acted on in capitals."""
    return condition.upper() if condition in _TO_ACT_ON else condition


def capital(text: str) -> str:
    """Return a text with a capital at its beginning."""
    return f"{text[:1].upper()}{text[1:]}"


def effectiveness(interval: Interval) -> str:
    """Return what is left of the control effectiveness, with its interval; less than nothing is nothing.

    Examples
    --------
    >>> effectiveness(Interval(estimate=0.52, low=0.31, high=0.73))
    '52 % (31–73)'
    """
    return f"{100 * max(interval.estimate, 0.0):.0f} % ({100 * interval.low:.0f}–{100 * interval.high:.0f})"


def subject_of(subject: str, actuator: str) -> str:
    """Return whose condition it is: an actuator's name, or of an axis its control.

    Examples
    --------
    >>> subject_of("actuator", "rudder"), subject_of("axis", "yaw"), subject_of("axis", "axes")
    ('rudder', 'yaw control', 'roll, pitch and yaw control')
    """
    moved = "roll, pitch and yaw" if actuator == "axes" else actuator
    return f"{moved} control" if subject == "axis" else actuator


def name(of: Verdict | Standing, assessment: Assessment) -> str:
    """Return whose verdict or standing it is, with its vehicle where the log holds several."""
    if of.actuator == ALL:
        return "every actuator"
    own = subject_of(of.subject, of.actuator)
    return own if len({other.vehicle for other in assessment.verdicts}) < 2 else f"{of.vehicle}: {own}"


def names(of: Sequence[Verdict], assessment: Assessment) -> str:
    """Return whose verdicts they are; motors and axes are named as a group.

    Examples
    --------
    >>> from mavhums.results.assessment import Assessment, LogSummary
    >>> kinds = {"axis": ("roll", "yaw"), "motor": ("motor 1", "motor 2", "motor 3")}
    >>> whole = Assessment(airframe=None, model=None, log=LogSummary(path=None, sha256=None, start_utc=None,
    ...     duration_s=1, vehicles=(1,), losses=Losses()), verdicts=[Verdict(subject=subject, vehicle=1,
    ...     actuator=one, condition="normal", worst="normal") for subject in kinds for one in kinds[subject]])
    >>> names(whole.verdicts[:2], whole), names(whole.verdicts[2:], whole)
    ('roll and yaw control', 'motors 1 to 3')
    """
    groups: dict[tuple[str, str], list[str]] = {}
    for verdict in sorted(of, key=lambda verdict: _ORDER.index(verdict.subject)):
        vehicle, _, own = name(verdict, assessment).rpartition(": ")
        groups.setdefault((vehicle, verdict.subject), []).append(own)
    return join(
        f"{vehicle}: {group_name(subject, several)}" if vehicle else group_name(subject, several)
        for (vehicle, subject), several in groups.items()
    )


def group_name(subject: str, several: Sequence[str]) -> str:
    """Return the names of subjects of one kind.

    Examples
    --------
    >>> group_name("motor", ["motor 1", "motor 2", "motor 3"]), group_name("axis", ["roll control"])
    ('motors 1 to 3', 'roll control')
    """
    if subject == "axis":
        return f"{join(one.removesuffix(' control') for one in several)} control"
    numbers = [int(one[6:]) for one in several if subject == "motor" and one[6:].isdecimal()]
    if len(numbers) > 1 and numbers == [*range(numbers[0], numbers[-1] + 1)]:
        return f"motors {numbers[0]} to {numbers[-1]}"
    return f"{len(several)} actuators" if len(several) > _NAMED else join(several)


def levels(
    degraded: float | None, emergency: float | None, *, falls: bool = False
) -> list[tuple[float, str]]:
    """Return the limits that are known with their names; what ``falls`` as a fault grows has them below it.

    Examples
    --------
    >>> levels(0.375, None), levels(0.75, 0.5, falls=True)
    ([(0.375, 'degraded above')], [(0.75, 'degraded below'), (0.5, 'emergency up to')])
    """
    names = ("degraded below", "emergency up to") if falls else ("degraded above", "emergency from")
    both = zip((degraded, emergency), names, strict=True)
    return [(value, name) for value, name in both if value is not None]


def axis_levels(limits: AxisLimits) -> list[tuple[float, str]]:
    """Return the levels that the effectiveness of an axis is compared with, and their names."""
    bounds = levels(limits.effectiveness_degraded, limits.effectiveness_emergency, falls=True)
    return [(1.0, "reference"), *bounds]


def clock(seconds: float) -> str:
    """Return a flight time as Rerun's time axis writes it.

    Examples
    --------
    >>> clock(53.24), clock(723.4), clock(3723)
    ('53.2s', '12m03s', '1h02m03s')
    """
    if round(seconds, 1) < 60:
        return f"{round(seconds, 1) + 0.0:.1f}s"  # a record just before the first frame is at no -0.0s
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}h{minutes:02d}m{rest:02d}s" if hours else f"{minutes}m{rest:02d}s"


def place_of(bearing_deg: float) -> str:
    """Return where a motor sits, by its bearing clockwise from the nose.

    Examples
    --------
    >>> place_of(45), place_of(-150), place_of(180), place_of(22.5)
    ('front right', 'rear left', 'rear', 'front right (22° from the nose)')
    """
    ahead, side = round(cos(radians(bearing_deg)), 6), round(sin(radians(bearing_deg)), 6)
    along, across = (("front", "rear"), ("right", "left"))
    words = [pair[part < 0] for part, pair in ((ahead, along), (side, across)) if part]
    place = " ".join(words)
    # Of an octa two sit in each quarter.
    even = abs(bearing_deg) % 45 == 0 or abs(bearing_deg) % 30 == 0
    return place if even else f"{place} ({abs(bearing_deg):.0f}° from the nose)"


def friction(interval: Interval) -> str:
    """Return a friction estimate with its interval, N·m.

    Examples
    --------
    >>> friction(Interval(estimate=0.5213, low=0.5, high=0.54))
    '0.521 (0.500–0.540)'
    """
    return f"{interval.estimate:.3f} ({interval.low:.3f}–{interval.high:.3f})"


def percent(fraction: float) -> str:
    """Return a fraction in per cent; only what is certain is called 0 or 100.

    Examples
    --------
    >>> percent(0.93), percent(0.9996), percent(0.0004), percent(1.0)
    ('93 %', '>99 %', '<1 %', '100 %')
    """
    if 0 < fraction < 0.01:
        return "<1 %"
    if 0.99 < fraction < 1:
        return ">99 %"
    return f"{fraction:.0%}".replace("%", " %")


def join(items: Iterable[str]) -> str:
    """Join items as a sentence does.

    Examples
    --------
    >>> join(["a", "b", "c"]), join(["a"])
    ('a, b and c', 'a')
    """
    *most, last = items
    return f"{', '.join(most)} and {last}" if most else last


TOKEN: Final = re.compile(r'"[^"]*"|[\w.]*\w|\W')
"""A word, a figure or a sign; what is in quotation marks is one."""


def merged(texts: Sequence[str]) -> str:
    """Return texts of as many tokens as one, in which those that differ are joined.

    Examples
    --------
    >>> merged(["12 % of roll, 30 % are needed", "4 % of yaw, 30 % are needed"])
    '12 and 4 % of roll and yaw, 30 % are needed'
    """
    columns = zip(*map(TOKEN.findall, texts), strict=True)
    return "".join(join(dict.fromkeys(column)) for column in columns)


def moment(utc: str) -> str:
    """Return a time as a reader writes it.

    Examples
    --------
    >>> moment("2026-01-01T09:01:07.003611+00:00")
    '2026-01-01 09:01:07 UTC'
    """
    return f"{utc[:10]} {utc[11:19]} UTC"


def flight_notes(assessment: Assessment) -> list[str]:
    """Return sentences on whose flight it is: earlier ones, other recordings of it, what was not checked."""
    log, earlier, said = assessment.log, assessment.earlier_flights, []
    if earlier:
        flights = "1 earlier flight" if earlier == 1 else f"{earlier:,} earlier flights"
        said.append(f"Compared with {flights} of this aircraft")
    elif earlier is not None:
        said.append("Compared with no earlier flight of this aircraft: the store has none")
    elif not any(notice.startswith(NOT_COMPARED) for notice in log.notices):
        said.append(f"{capital(NOT_COMPARED)}: no store is read (--keep makes one)")
    said += [capital(notice) for notice in log.notices]
    if log.copies:
        others = join(sorted({copy.log or "a live link" for copy in log.copies}))
        best = next((copy.log or "a live link" for copy in log.copies if copy.counts), None)
        said.append(f"The flight is also recorded in {others}; {best or 'this log'} counts")
    return said


_COUNTS: Final = {
    "bytes_skipped": ("byte skipped", "bytes skipped"),
    "damaged_regions": ("damaged region", "damaged regions"),
    "bad_crc_frames": ("frame with a wrong checksum", "frames with a wrong checksum"),
    "implausible_times": ("implausible time", "implausible times"),
    "cut_end_bytes": ("byte of a frame cut off at the end", "bytes of a frame cut off at the end"),
    "padded_frames": ("frame in doubt", "frames in doubt"),
    "unsigned_frames": ("unsigned frame", "unsigned frames"),
    "bad_signatures": ("frame with a wrong signature", "frames with a wrong signature"),
    "replayed_frames": ("replayed frame", "replayed frames"),
    "unknown_frames": ("frame of an unknown kind", "frames of an unknown kind"),
    "missing_frames": ("frame missing by sequence number", "frames missing by sequence number"),
    "reordered_frames": ("frame out of order", "frames out of order"),
    "duplicated_frames": ("duplicated frame", "duplicated frames"),
    "dropped_datagrams": ("datagram dropped by the kernel", "datagrams dropped by the kernel"),
    "logger_dropped": ("record that the logger dropped", "records that the logger dropped"),
    "late_samples": ("sample too late", "samples too late"),
    "same_time_samples": ("sample at the time of another", "samples at the times of others"),
    "broken_stamps": ("broken time stamp", "broken time stamps"),
    "copies": ("copy", "copies"),
}
"""What a field of the losses of a log or of a link counts: of one, and of several."""


def counted(lost: Losses | LinkStatus) -> list[str]:
    """Return what was lost or refused, each kind with its number, and by message where that is known."""
    parts = []
    for field, (one, many) in _COUNTS.items():
        count = getattr(lost, field, 0)
        total = count if isinstance(count, int) else sum(count.values())
        which = "" if isinstance(count, int) else ", ".join(f"{name} {n:,}" for name, n in count.items())
        what = f"{total:,} {one if total == 1 else many}{f' ({which})' if which else ''}"
        parts += [what] if total else []
    return parts


def losses(lost: Losses) -> str:
    """Return the losses of the log, in one line."""
    parts = counted(lost)
    missing = link_loss(lost)
    if missing is None:
        return join(parts) if parts else "none"
    return f"{join(parts) if parts else 'file intact'}; {missing}"


_MUCH: Final = 0.05  # lost on the link: the rates of its messages fall by as much


def grave_losses(lost: Losses) -> list[str]:
    """Return the losses that may bear on a verdict: a part of the flight is missing, or forged.

    A late sample, or a byte between frames, changes nothing.

    Examples
    --------
    >>> grave_losses(Losses(damaged_regions=3, bytes_skipped=40)), grave_losses(Losses(bytes_skipped=40))
    (['3 damaged regions'], [])
    """
    grave = ("damaged_regions", "logger_dropped", "replayed_frames", "bad_signatures")
    kept = counted(Losses(**{field: getattr(lost, field) for field in grave}))
    missing = link_loss(lost)
    return [*kept, missing] if missing and _share_missing(lost) >= _MUCH else kept


def link_loss(lost: Losses) -> str | None:
    """Return the loss on the link, according to sequence numbers; None if nothing is missing.

    Examples
    --------
    >>> sender = dict(gaps=3, reordered=0, duplicated=0)
    >>> link_loss(Losses(sequence=[dict(system=1, component=1, frames=952, missing=48, **sender)]))
    'the radio link lost 4.8 %'
    """
    share = _share_missing(lost)
    return f"the radio link lost {max(100 * share, 0.1):.1f} %" if share else None


def _share_missing(lost: Losses) -> float:
    missing = sum(sender.missing for sender in lost.sequence)
    return missing / (missing + sum(sender.frames for sender in lost.sequence)) if missing else 0.0
