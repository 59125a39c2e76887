"""One actuator's health through a flight: samples in, windows and changes out, a verdict at the end."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit

from mavhums.actuator.profile import Actuator
from mavhums.assessment import Condition, Coverage, Evidence, Interval, Suspect
from mavhums.events import ConditionChanged, Window
from mavhums.health.decision import Change, Decision, rule
from mavhums.health.friction import Moments, estimate_friction, friction_moments
from mavhums.health.motion import motion
from mavhums.health.slots import Slot, SlotCutter
from mavhums.health.votes import Classifier, Votes, count_votes, vote_share

__all__ = ["WINDOW_S", "Findings", "Monitor"]

WINDOW_S = 10
_EPISODES_KEPT = 100
_T_95 = float(stdtrit(WINDOW_S - 1, 0.975))


@dataclass(frozen=True, slots=True)
class _Second:
    index: int
    samples: int
    moving: int
    friction: Moments
    votes: Votes | None


@dataclass(slots=True)
class _Episode:
    """An unbroken stay in one condition; ``peak`` is the highest friction estimated in it."""

    condition: Condition
    start_s: float
    end_s: float
    peak: float


@dataclass(frozen=True, slots=True)
class Findings:
    """What a flight showed of one actuator; ``last_s`` is the flight time of its last sample."""

    condition: Condition
    worst: Condition
    since_s: float | None
    friction: Interval | None
    p_emergency: float | None
    coverage: Coverage
    suspects: tuple[Suspect, ...]
    evidence: tuple[Evidence, ...]
    last_s: float


class Monitor:
    """Judges one actuator of one vehicle.

    Of more than a hundred stays in one condition the first and the latest fifty are evidence.

    Parameters
    ----------
    vehicle
        System id.
    actuator
        From the airframe profile.
    network
        Whose votes are shown beside the friction; None for no votes.

    Raises
    ------
    ProfileError
        If the profile leaves the actuator's constants or limits open.
    """

    def __init__(self, vehicle: int, actuator: Actuator, network: Classifier | None = None) -> None:
        self.vehicle = vehicle
        self.actuator = actuator
        self._network = network
        self._cutter = SlotCutter()
        self._seconds: deque[_Second] = deque(maxlen=WINDOW_S)
        self._first: int | None = None
        self._limits = actuator.known_limits()
        self._torque_uncertainty = actuator.known_ema().torque_uncertainty
        self._decision = Decision(self._limits)
        self._episodes: list[_Episode] = []
        self._windows = self._decidable = self._samples = self._moving = 0
        self._last: Window | None = None

    def feed(
        self, time_s: NDArray[np.float64], values: NDArray[np.float64]
    ) -> Iterator[Window | ConditionChanged]:
        """Take samples at flight times ``time_s`` (n,), ``values`` V1…V12 (n, 12)."""
        yield from self._judge(self._cutter.feed(time_s, values))

    def finish(self) -> Iterator[Window | ConditionChanged]:
        """Judge what is left."""
        yield from self._judge(self._cutter.finish())

    def findings(self) -> Findings:
        """Return what was found so far."""
        last = self._last
        return Findings(
            condition=self._decision.condition,
            worst=self._decision.worst,
            since_s=self._decision.since_s,
            friction=last.friction_nm if last else None,
            p_emergency=last.p_emergency if last else None,
            coverage=Coverage(
                moving_fraction=self._moving / self._samples if self._samples else 0.0,
                windows=self._windows,
                decidable=self._decidable,
                late=self._cutter.late,
            ),
            last_s=self._cutter.latest_s,
            suspects=self._suspects(),
            evidence=tuple(self._evidence()),
        )

    def _judge(self, slots: Iterable[Slot]) -> Iterator[Window | ConditionChanged]:
        for slot in slots:
            second = self._summarise(slot)
            if second is None:
                continue
            self._samples += second.samples
            self._moving += second.moving
            self._first = slot.index if self._first is None else self._first
            self._seconds.append(second)
            if slot.index - self._first + 1 >= WINDOW_S:
                yield from self._window(slot.index)

    def _summarise(self, slot: Slot) -> _Second | None:
        seen = motion(self.actuator, slot)
        if seen is None:
            return None
        votes = count_votes(self._network, seen) if self._network else None
        moving = int(np.count_nonzero(seen.moving))
        return _Second(slot.index, len(seen.moving), moving, friction_moments(self.actuator, seen), votes)

    def _window(self, last_index: int) -> Iterator[Window | ConditionChanged]:
        start_s, end_s = float(last_index + 1 - WINDOW_S), float(last_index + 1)
        seconds = [second for second in self._seconds if second.index >= start_s]
        friction = estimate_friction([s.friction for s in seconds], self._torque_uncertainty)
        share = vote_share([s.votes for s in seconds if s.votes is not None])
        limits = self._limits
        if friction is not None and friction.high - friction.low > limits.emergency - limits.normal:
            friction = None
        change = self._decision.feed(friction, start_s, end_s)
        samples = sum(second.samples for second in seconds)
        window = Window(
            vehicle=self.vehicle,
            actuator=self.actuator.name,
            start_s=start_s,
            end_s=end_s,
            moving_fraction=sum(second.moving for second in seconds) / samples,
            friction_nm=friction,
            p_emergency=share,
            condition=self._decision.condition,
        )
        self._windows += 1
        if friction is not None:
            self._decidable += 1
            self._last = window
            self._extend_episode(change, end_s, friction.estimate)
        yield window
        if change is not None:
            yield ConditionChanged(
                self.vehicle,
                self.actuator.name,
                change.time_s,
                change.since_s,
                change.before,
                change.after,
                rule(change.after, limits),
            )

    def _extend_episode(self, change: Change | None, end_s: float, estimate: float) -> None:
        if change is not None:
            if self._episodes:
                self._episodes[-1].end_s = change.since_s
            self._episodes.append(_Episode(change.after, change.since_s, end_s, estimate))
            if len(self._episodes) > _EPISODES_KEPT:
                del self._episodes[_EPISODES_KEPT // 2]
        elif self._episodes:
            episode = self._episodes[-1]
            episode.end_s, episode.peak = end_s, max(episode.peak, estimate)

    def _evidence(self) -> Iterator[Evidence]:
        limits = self._limits
        for episode in self._episodes:
            yield Evidence(
                kind="friction",
                start_s=episode.start_s,
                end_s=episode.end_s,
                value=episode.peak,
                limit=limits.emergency if episode.condition == "emergency" else limits.normal,
                rule=rule(episode.condition, limits),
            )
        if self._last is not None and self._last.p_emergency is not None:
            yield Evidence(
                kind="network",
                start_s=self._last.start_s,
                end_s=self._last.end_s,
                value=self._last.p_emergency,
                limit=0.5,
                rule=self._agreement(self._last.p_emergency),
            )

    def _agreement(self, share: float) -> str:
        opposed = {"normal": share > 0.5, "emergency": share <= 0.5}.get(self._decision.condition, False)
        text = "network: part of the window's moving samples that it calls an emergency; friction decides"
        return f"{text}, and the network disagrees" if opposed else text

    def _suspects(self) -> tuple[Suspect, ...]:
        """Name friction, with the probability that it exceeds the normal limit, where it does."""
        if self._decision.condition not in ("degraded", "emergency") or not self._last:
            return ()
        friction = self._last.friction_nm
        if friction is None:
            return ()
        error = (friction.high - friction.estimate) / _T_95
        probability = float(stdtr(WINDOW_S - 1, (friction.estimate - self._limits.normal) / error))
        return (Suspect(fault="friction", confidence=probability),)
