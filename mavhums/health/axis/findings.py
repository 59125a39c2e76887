"""What a flight shows about one axis, before it becomes a verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mavhums.core.conditions import Condition
from mavhums.health.axis.reference import Reference, Standards
from mavhums.health.axis.response_sums import Response
from mavhums.results.sections import AxisLimits
from mavhums.results.standing import Interval
from mavhums.results.verdict import Coverage, Evidence, Suspect


@dataclass(frozen=True, slots=True)
class AxisFindings:
    """The findings of a flight about one axis.

    Attributes
    ----------
    reference, best
        The reference used, or else the best candidate; None if there is none.
    usable_s
        Seconds of forward flight in which its demand was known, until the reference.
    effectiveness, windows
        The mean since the last change of the condition, or of a loss the value since its onset, with its
        95 % interval; and the number of windows in the mean, 0 for a loss.
    doubt
        The effectiveness over the last minute, where a loss of 40 % is not excluded by it.
    spacing_s
        Time between samples of the outputs or the rates, where a reference was sought.
    needs
        Requirements on a reference.
    limits
        Limits by which the axis was judged.
    from_take_off
        Whether the flight is known from its take-off on.
    shares
        Of two mixed surfaces that move the axis, the probability that it is the ``left``, the ``right`` or
        ``both``; empty where nothing tells.
    response
        Sums of the flight, for the comparison with other flights; None without any.
    """

    axis: str
    condition: Condition
    worst: Condition
    since_s: float | None
    coverage: Coverage
    suspects: tuple[Suspect, ...]
    evidence: tuple[Evidence, ...]
    effectiveness: Interval | None
    doubt: Interval | None
    windows: int
    reference: Reference | None
    best: Reference | None
    usable_s: int
    spacing_s: float
    needs: Standards
    limits: AxisLimits
    from_take_off: bool
    shares: Mapping[str, float] = field(default_factory=dict)
    response: Response | None = None
