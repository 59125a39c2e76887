"""Sentences on the states of actuators over their flights, and on what changed in a fleet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from math import ceil, floor

from mavhums.core.conditions import SEVERITY
from mavhums.results.standing import (
    Change,
    FleetDigest,
    FlightsLeft,
    Growth,
    Standing,
    Step,
)
from mavhums.results.verdict import Verdict
from mavhums.show.blocks import Block, Headline, Listing, Mark, Note
from mavhums.show.words import capital, condition_word, join, subject_of


def sentences(standing: Standing) -> list[str]:
    """Return what is wrong, since when, what grows, and what changed in one step; empty where all is well.

    Examples
    --------
    >>> sentences(Standing(vehicle=1, actuator="rudder", airframe=None, condition="normal", last="normal",
    ...     flights=3, last_utc="2026-03-01T09:00:00+00:00", log=None))
    []
    """
    said = []
    if SEVERITY[standing.condition] > 0:
        text = f"{standing.condition} {since_words(standing)}".rstrip()
        if value := value_words(standing):
            text = f"{text}: {value}"
        if count := standing.clear_flights:
            text += f"; not seen in the last {f'{count} flights' if count > 1 else 'flight'}"
        said.append(text)
    if standing.growth is not None:
        said.append(growth_words(standing.growth))
    if standing.step is not None:
        said.append(step_words(standing.step))
    return said


def sentence(standing: Standing) -> str:
    """Return the sentences as one, with the condition as a table shows it."""
    return "; ".join(sentences(standing)).replace(standing.condition, condition_word(standing.condition), 1)


def found_in(verdict: Verdict, standing: Standing | None) -> str:
    """Return what was found about a subject over its flights, else in the last, or why nothing is known."""
    if standing is not None and standing.is_finding:
        return "; ".join(sentences(standing))
    suspects = [item.fault.replace("_", " ") for item in verdict.suspects]
    friction = f"friction {verdict.friction_nm.estimate:.3f} N·m" if verdict.friction_nm else ""
    suspected = f"suspected: {join(suspects)}" if suspects else ""
    return "; ".join(filter(None, (friction, suspected, verdict.reason)))


def mark_of(standing: Standing) -> Mark:
    """Return what a list shows as the state: what grows is not called normal."""
    if standing.growth is not None and SEVERITY[standing.condition] <= 0:
        return Mark("changed", "grows")
    return Mark(standing.condition)


def value_words(standing: Standing) -> str:
    """Return the finding's own quantity with its value and limit."""
    unit = _unit(standing.unit)
    if standing.value is not None:
        most, bound = standing.highest, standing.limit
        limit = "" if bound is None else f" (limit {bound:.3g}{unit})"
        shown = f"{standing.value.estimate:.3g}"
        # The mean over the flight may lie below a limit that was passed in it.
        if bound is not None and most is not None and standing.value.estimate <= bound < most:
            shown = f"up to {most:.3g}"
        return f"{standing.quantity} {shown}{unit}{limit}"
    if standing.quantity is not None:
        return standing.quantity.partition(": ")[2] or standing.quantity
    return (standing.fault or standing.reason or "").replace("_", " ")


def since_words(standing: Standing) -> str:
    """Return since which flight the fault is there; empty where there is none."""
    if standing.since_flight is None or standing.since_utc is None:
        return ""
    return f"since flight {standing.since_flight} of {standing.flights} ({standing.since_utc[:10]})"


def growth_words(growth: Growth) -> str:
    """Return what grows, how fast, since when, and the flights left to each limit that is not reached."""
    slope, unit = growth.per_flight, _unit(growth.unit)
    way = "grows" if slope.estimate > 0 else "falls"
    said = (
        f"{growth.quantity} {way} by {abs(slope.estimate):.2g}{unit} a flight"
        f" since flight {growth.since_flight} ({growth.since_utc[:10]})"
    )
    limits = [(left_words(left), word) for left, word in _limits(growth)]
    return "; ".join([said, *(f"{left} until {word}" for left, word in limits)])


def soonest_words(growth: Growth) -> str:
    """Return the flights left to each limit that is ahead."""
    return join(
        [f"{left_words(left)} until {word}" for left, word in _limits(growth)] or ["no limit is ahead"]
    )


def left_words(left: FlightsLeft) -> str:
    """Return flights left with their interval and date.

    Examples
    --------
    >>> left_words(FlightsLeft(estimate=30.4, low=24.1, high=40.2, expected_utc="2026-12-01"))
    '30 flights (24–41), about 2026-12-01,'
    >>> left_words(FlightsLeft(estimate=300, low=200, high=None, is_far=True))
    'more than 200 flights'
    """
    low = floor(left.low)
    if left.is_far or left.high is None:
        return f"more than {low:,} flights"
    count = round(left.estimate)
    text = f"{count:,} flight{'s' if count != 1 else ''} ({low:,}–{ceil(left.high):,})"
    return f"{text}, about {left.expected_utc}," if left.expected_utc else text


def step_words(step: Step) -> str:
    """Return a change between two flights, and what it may be."""
    way = "rose" if step.size > 0 else "fell"
    why = (
        "a repair or swap? record it, and later flights are compared with those since"
        if step.better
        else "damage, or another part? inspect it; if it was swapped, record it"
    )
    return (
        f"{step.quantity} {way} by {abs(step.size):.2g}{_unit(step.unit)} in one step"
        f" at flight {step.flight} ({step.at_utc[:10]}): {why}"
    )


def _limits(growth: Growth) -> list[tuple[FlightsLeft, str]]:
    both = ((growth.to_degraded, "degraded"), (growth.to_emergency, "emergency"))
    return [(left, word) for left, word in both if left is not None and left.estimate > 0]


def _unit(unit: str | None) -> str:
    return "" if unit in (None, "1") else f" {unit}"


# What changed: the title of its section, and its word in the headline.
_KINDS = {
    "new": ("New findings", "new"),
    "worse": ("Worse", "worse"),
    "growing": ("Growing", "growing"),
    "step": ("Changed in one step", "changed in one step"),
    "eased": ("Eased", "eased"),
    "gone": ("Gone", "gone"),
}


def digest_headline(digest: FleetDigest) -> str:
    """Return the digest in one line.

    Examples
    --------
    >>> times = dict(since_utc="2026-03-01T06:00:00+00:00", until_utc="2026-03-02T06:00:00+00:00")
    >>> digest_headline(FleetDigest(**times, aircraft=20, flights=31, standing=2))
    'Nothing new since 2026-03-01 06:00 UTC: 31 flights of 20 aircraft; 2 findings open'
    """
    counts: Counter[str] = Counter(one.kind for one in digest.changes)
    parts = [f"{counts[kind]} {word}" for kind, (_, word) in _KINDS.items() if counts[kind]]
    parts += [f"{len(digest.silent)} not heard of"] if digest.silent else []
    parts += [f"{len(digest.failed)} logs failed"] if digest.failed else []
    since = f"{digest.since_utc[:16].replace('T', ' ')} UTC"
    flown = f"{_count(digest.flights, 'flight')} of {digest.aircraft} aircraft"
    rest = [flown]
    if digest.standing:
        rest.append(f"{_count(digest.standing, 'finding')} open")
    rest += [f"{digest.silent_longer} silent for longer"] if digest.silent_longer else []
    return f"{', '.join(parts) or 'Nothing new'} since {since}: {'; '.join(rest)}"


def digest_blocks(digest: FleetDigest) -> list[Block]:
    """Return what is shown of a digest; where there is nothing to say, its headline."""
    notice = [] if digest.is_empty else [Note([f"{capital(digest.notice)}."], quiet=True)]
    return [Headline(digest_headline(digest)), *_sections(digest), *notice]


def _sections(digest: FleetDigest) -> Iterator[Listing]:
    for kind, (title, _) in _KINDS.items():
        found = [one for one in digest.changes if one.kind == kind]
        if found:
            yield Listing(title, [f"{_whose(one)}: {'. '.join(_change_lines(one))}" for one in found])
    if digest.silent:
        lines = [
            f"{one.aircraft}: last flight {one.last_utc[:10]}, {one.days:.0f} days ago"
            for one in digest.silent
        ]
        yield Listing("Not heard of", lines)
    if digest.failed:
        lines = [f"{one.problem}: {one.remedy}" for one in digest.failed]
        yield Listing("Logs that could not be judged", lines)


def _whose(change: Change) -> str:
    return f"{change.aircraft} {subject_of(change.now.subject, change.now.actuator)}"


def _change_lines(change: Change) -> list[str]:
    now, before = change.now, change.before
    if change.kind == "step" and now.step is not None:
        return [step_words(now.step)]
    if change.kind == "growing" and now.growth is not None:
        return [growth_words(now.growth)]
    if change.kind in ("gone", "eased") and before is not None:
        was = before.condition if before.growth is None or before.condition != "normal" else "growing"
        state = "growing" if now.growth and now.condition == "normal" else now.condition
        why = f"it was {was}; now {state} in flight {now.flights} ({now.last_utc[:10]})"
        return [why, *sentences(now)[:1]] if change.kind == "eased" else [why]
    return [said for said in sentences(now) if now.step is None or said != step_words(now.step)]


def _count(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"
