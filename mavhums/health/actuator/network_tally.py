"""What the networks say of one actuator over a flight: counts in bounded memory, and a condition by runs.

A condition is held once the network is sure of at least that in two windows that share no sample, and no
window between leans to less; a milder one likewise.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from mavhums.core.arrays import Array
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.health.actuator.votes import Ballot, VoteOutcome
from mavhums.health.decision.conditions import Episodes, IndicatorChange
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.learn import Model
from mavhums.results.reasons import Reason
from mavhums.results.sections import Decide, ModelSummary, NetworkAnswer, WindowsOfClass, fault_of
from mavhums.results.verdict import ABSTAINED, OUTSIDE, Evidence, Suspect

_BALLOT = Ballot()


class NetworkTally:
    """Counts the networks' answers on one actuator.

    Parameters
    ----------
    networks
        The networks; the one with the most inputs comes first.

    Attributes
    ----------
    worst
        The gravest condition that was held.
    """

    def __init__(self, networks: Sequence[Model]) -> None:
        self._networks = networks
        self.worst: Condition = "undecided"
        self._agreement = _Agreement()
        self._like: dict[int, VoteOutcome] = {}
        self._windows: Counter[str] = Counter()
        self._probabilities: defaultdict[str, float] = defaultdict(float)
        self._latest: VoteOutcome | None = None
        self._held: VoteOutcome | None = None
        self._worst_says: str | None = None
        self._episodes = Episodes()
        self._first_s: float | None = None
        self._samples = np.zeros((len(networks), 2))

    def count(self, ballots: Array) -> None:
        """Add the ballots of new slots, shape (slots, 6): samples that voted, and those for an emergency."""
        for k in range(len(self._samples)):
            own = ballots[ballots[:, _BALLOT.network] == k]
            self._samples[k] += own[:, _BALLOT.voters].sum(), own[:, _BALLOT.emergency].sum()

    def feed(
        self, outcomes: Sequence[VoteOutcome | None], end_s: Sequence[float]
    ) -> Iterator[tuple[int, IndicatorChange]]:
        """Take the outcomes of the windows that end at ``end_s``; yield each change, with its window."""
        for k, (said, end) in enumerate(zip(outcomes, end_s, strict=True)):
            if said is None:
                continue
            self._latest = said
            self._windows[said.said] += 1
            self._probabilities[said.said] += said.probability
            changed = said.said != OUTSIDE and self._agreement.feed(said, end - WINDOW_S)
            if said.severity < 0:
                continue
            if said.severity == SEVERITY["emergency"] and self._first_s is None:
                # The middle of the window is the best guess of the moment.
                self._first_s = end - WINDOW_S / 2
            self._like[said.severity] = said
            if changed:
                condition, since_s = _CONDITIONS[self._agreement.severity], self._agreement.since_s
                self._held = self._like.get(self._agreement.severity, said)
                if SEVERITY[condition] > SEVERITY[self.worst]:
                    self.worst, self._worst_says = condition, self._held.likely
                self._episodes.begin_decided(condition, since_s, end, said.probability)
                yield k, IndicatorChange(condition, since_s, _rule(condition))
            else:
                agrees = said.severity == self._agreement.severity
                self._episodes.extend(said.probability, end, agrees=agrees)

    def answer(self, decides: Decide = "physics") -> NetworkAnswer | None:
        """Return what the network with most votes said; None if none was asked about a window.

        ``decides`` is who decides the verdict.
        """
        if self._latest is None:
            return None
        most = int(self._samples[:, 0].argmax())
        (voters, emergency), network = self._samples[most].tolist(), self._networks[most]
        first_s = self._first_s
        return NetworkAnswer(
            model=ModelSummary(name=network.card.name, hash=network.hash),
            inputs={"samples": network.keys, "windows": network.window_quantities},
            windows=self._decided_windows,
            classes={
                said: WindowsOfClass(windows=n, probability=round(self._probabilities[said] / n, 4))
                for said, n in self._windows.most_common()
            },
            says=self._worst_says,
            latest=self._latest.said,
            probability=round(self._latest.probability, 4),
            first_emergency_s=None if first_s is None else round(first_s, 3),
            share_of_samples=round(emergency / max(voters, 1.0), 4),
            condition=self.worst,
            decides=decides,
        )

    def evidence(self) -> tuple[Evidence, ...]:
        """Return the periods through which the network held one condition; for a flight that it decides."""
        return tuple(
            Evidence(
                kind="network",
                start_s=episode.start_s,
                end_s=episode.end_s,
                value=episode.peak,
                rule=_rule(episode.condition),
            )
            for episode in self._episodes
        )

    def suspect(self) -> Suspect | None:
        """Return the fault whose class the network holds, with its probability in the window that decided."""
        if self._held is None or not self._held.severity:
            return None
        return Suspect(fault=fault_of(self._held.likely), confidence=self._held.probability)

    def why_undecided(self, *, physics: bool) -> Reason:
        """Return the reason if the network decides and held no condition.

        ``physics`` says whether the profile has the constants and limits by which it could decide.
        """
        by_physics = (
            "let the physics decide (--decide physics)"
            if physics
            else "fill in the profile's constants and limits"
        )
        if self._latest is None:
            return Reason("network_unfed", physics=by_physics)
        total, outside = self._windows.total(), self._windows[OUTSIDE]
        if outside > total / 2:
            return Reason("network_outside", outside=outside, windows=total, physics=by_physics)
        return Reason("network_unsure", sure=self._decided_windows, windows=total, physics=by_physics)

    @property
    def _decided_windows(self) -> int:
        return self._windows.total() - self._windows[ABSTAINED] - self._windows[OUTSIDE]


def _rule(condition: Condition) -> str:
    return f"{condition}: the network is sure of it in two separate windows, and none between contradicts"


class _Agreement:
    """The severity that windows agree on, and from when on; -1 before they do."""

    def __init__(self) -> None:
        self.severity, self.since_s = -1, 0.0
        # The first sure window since which all say at least, or at most, a severity; NaN without one.
        self._at_least = {1: np.nan, 2: np.nan}
        self._at_most = {1: np.nan, 0: np.nan}

    def feed(self, said: VoteOutcome, start_s: float) -> bool:
        """Take what a network says of the window that starts then; return whether it changes the severity."""
        before = self.severity
        for runs, way in ((self._at_most, -1), (self._at_least, 1)):
            for level, first_s in runs.items():
                if way * (said.leaning - level) < 0:
                    runs[level] = np.nan
                elif said.severity >= 0 and way * (said.severity - level) >= 0:
                    runs[level] = start_s if np.isnan(first_s) else first_s
                    known = before if before >= 0 else 0.5  # before any agreement, neither sound nor faulty
                    if first_s + WINDOW_S <= start_s and way * (level - known) > 0:
                        # The first condition of a flight holds from its window's start; a change lies within.
                        self.severity, self.since_s = level, first_s if before < 0 else first_s + WINDOW_S / 2
        return self.severity != before


_CONDITIONS: tuple[Condition, ...] = ("normal", "degraded", "emergency")
