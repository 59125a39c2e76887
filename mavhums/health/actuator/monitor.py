"""Health monitoring of one actuator through a flight, from samples to windows, changes and findings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Flags
from mavhums.core.conditions import Condition
from mavhums.core.quantities import SUMS
from mavhums.core.statistics import TAIL_95
from mavhums.health.actuator.detector import DetectorInput
from mavhums.health.actuator.detectors import detectors_for
from mavhums.health.actuator.detectors.friction import why_no_friction
from mavhums.health.actuator.indicator_tracker import (
    IndicatorTracker,
    evidence_of,
    indicator_of,
    suspect_of,
)
from mavhums.health.actuator.network_tally import NetworkTally
from mavhums.health.actuator.votes import (
    VOTE_COLUMNS,
    VoteOutcome,
    count_votes,
    network_inputs,
    outcomes,
    window_outcomes,
)
from mavhums.health.decision.conditions import ConditionTracker, IndicatorChange
from mavhums.health.decision.events import ConditionChanged, Indication, Window
from mavhums.health.decision.limits import Estimates, half_width
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.health.estimation.equations import Fits
from mavhums.health.estimation.equations.data_sheet import Load
from mavhums.health.estimation.motion import Motion, motion, window_sums
from mavhums.health.estimation.slots import SlotCutter, Slots, Windows, with_extra_columns
from mavhums.health.estimation.strokes import collectors
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.learn import Model
from mavhums.results.reasons import Reason
from mavhums.results.sections import Decide, NetworkAnswer
from mavhums.results.verdict import Coverage, Evidence, Indicator, Interval, OwnRecord, Suspect

MonitorEvent = Window | ConditionChanged | Indication


@dataclass(frozen=True, slots=True)
class ActuatorFindings:
    """Results of a flight for one actuator.

    ``network`` is what the networks say; ``last_s`` is the flight time of the last sample; ``no_friction`` is
    the reason if an undecided flight shows no friction.
    """

    condition: Condition
    worst: Condition
    since_s: float | None
    friction: Interval | None
    network: NetworkAnswer | None
    coverage: Coverage
    suspects: tuple[Suspect, ...]
    evidence: tuple[Evidence, ...]
    indicators: tuple[Indicator, ...]
    last_s: float
    own: tuple[OwnRecord, ...] = ()
    own_gap: Reason | None = None
    no_friction: Reason | None = None


class Monitor:
    """Judges one actuator of one vehicle.

    Parameters
    ----------
    vehicle
        System id.
    actuator
        Actuator of the airframe profile; missing constants limit what can be judged.
    networks
        Networks whose votes are shown beside the physics; the one with the most inputs comes first.
    decide
        Who decides the friction: the physics, the networks, if there are any, or both. The networks do in any
        case if the profile has no limits, without which the physics decides no friction.
    false_alarms
        Allowed number of false alarms per 100 hours.
    """

    def __init__(
        self,
        vehicle: int,
        actuator: Actuator,
        networks: Sequence[Model] = (),
        *,
        decide: Decide = "physics",
        false_alarms: float = FALSE_ALARMS,
    ) -> None:
        self.vehicle = vehicle
        self.actuator = actuator
        self._networks = networks
        self._cutter = SlotCutter()
        # With all constants and limits the data sheet decides; a current at the bus is another quantity than
        # the motor's.
        open_limits = bool(actuator.blanks) or actuator.esc_side == "bus"
        self._own = collectors(actuator) if open_limits else []
        self._load = Load(actuator) if actuator.ema else None
        self._latest_s = -np.inf
        detectors = detectors_for(actuator)
        self._trackers = {
            detector.fault: IndicatorTracker(detector, false_alarms=false_alarms) for detector in detectors
        }
        self._fits = Fits(actuator, {name for detector in detectors for name in detector.equations})
        self._counts = Windows(2)
        self._votes = Windows(VOTE_COLUMNS)
        self._sums = Windows(SUMS)
        # The statistics of windows need the gear ratio.
        self._by_window = bool(actuator.ema) and any(network.window_classes for network in networks)
        self._first: int | None = None
        self._held = ConditionTracker(vehicle, actuator.name)
        self._windows = self._decidable = self._samples = self._moving = self._slots = 0
        self._friction: Interval | None = None
        self._tally = NetworkTally(networks)
        self._by_network = bool(networks) and (decide == "network" or "friction" not in self._trackers)
        self._decides: Decide = "network" if self._by_network else "both" if decide == "both" else "physics"

    def feed(
        self,
        time_s: Array,
        values: Array,
        measured: Flags | None = None,
        bus_v: Array | None = None,
        airspeed: Array | None = None,
        magnitudes: Array | None = None,
    ) -> Iterator[MonitorEvent]:
        """Process samples at flight times ``time_s`` (n,), which increase, ``values`` V1…V12 (n, 12).

        ``measured`` (n, 12) marks measured values, as opposed to derived ones; all if omitted. The rotor's
        angle is evidence beside the output shaft's only if a sensor gave each. ``bus_v`` (n,) is the voltage
        of the supply bus, where an ESC there measures it, and ``airspeed`` (n,) the aircraft's, m/s, where it
        is known. ``magnitudes`` (n, 3) are those of V4, V5 and V7 from a source without signs. What no
        actuator can reach counts as missing.
        """
        if not time_s.size:
            return
        self._latest_s = float(time_s[-1])
        columns = with_extra_columns(values, measured, bus_v, airspeed, magnitudes)
        yield from self._judge(self._cutter.feed(time_s, columns))

    def finish(self) -> Iterator[MonitorEvent]:
        """Process the remaining samples, and judge by the whole flight what its windows left undecided."""
        yield from self._judge(self._cutter.finish())
        # On a held shaft no balance of torques or angles is valid, over the flight neither.
        if self._first is None or self._windows == 0 or self._held.jammed:
            return
        whole, start_s, end_s = self._fits.whole(), float(self._first), self._latest_s
        trackers = self._deciding()
        friction = trackers.get("friction")
        # What no window shows, as play that the load seldom crosses, the whole flight may, if windows show
        # the friction. Samples too few or too doubtful for any window do not become evidence by their number,
        # but what is surely an emergency needs none: a grave fault leaves few samples in motion.
        changes = {
            fault: change
            for fault, tracker in trackers.items()
            if (tracker.judged or (friction and friction.judged) or tracker.surely_grave(whole))
            and (change := tracker.conclude(whole, start_s, end_s))
        }
        yield from self._changed(changes, end_s)
        self._friction = (friction and friction.concluded) or self._friction

    @property
    def condition(self) -> Condition:
        """The actuator's present condition."""
        return self._held.condition

    @property
    def worst(self) -> Condition:
        """The actuator's worst condition so far."""
        return self._held.worst

    def findings(self, *, indicators: bool = True) -> ActuatorFindings:
        """Return the findings so far; the ``indicators`` are evaluated over the whole flight."""
        whole = self._fits.whole() if indicators else {}
        trackers, deciding = self._trackers.values(), self._deciding().values()
        suspects = [suspect for tracker in deciding if (suspect := suspect_of(tracker))]
        load = self._load.mean if self._load else None
        shown = [i for one in trackers if whole and (i := indicator_of(one, whole, load))]
        evidence = [e for tracker in deciding for e in evidence_of(tracker)]
        if self._by_network:
            evidence += self._tally.evidence()
            suspects += filter(None, [self._tally.suspect()])
        return ActuatorFindings(
            condition=self._held.condition,
            worst=self._held.worst,
            since_s=self._held.since_s,
            friction=self._friction,
            network=self._tally.answer(self._decides),
            coverage=Coverage(
                moving_fraction=self._moving / self._samples if self._samples else 0.0,
                windows=self._windows,
                decidable=max([self._decidable, *(t.faulty_windows for t in deciding)]),
            ),
            last_s=self._latest_s,
            suspects=tuple(sorted(suspects, key=lambda each: -each.confidence)),
            evidence=tuple(sorted(evidence, key=lambda each: each.start_s)),
            indicators=tuple(shown),
            own=tuple(record for own in self._own if indicators and (record := own.record())),
            own_gap=next((gap for own in self._own if (gap := own.gap)), None),
            no_friction=self._why_no_friction() if self._held.condition == "undecided" else None,
        )

    def _deciding(self) -> dict[str, IndicatorTracker]:
        """Return the trackers that decide the condition: all, or all but that of the friction."""
        if not self._by_network:
            return self._trackers
        return {fault: tracker for fault, tracker in self._trackers.items() if fault != "friction"}

    def _why_no_friction(self) -> Reason | None:
        if self._by_network:
            return self._tally.why_undecided(physics="friction" in self._trackers)
        tracker, lasted_s = self._trackers.get("friction"), float(self._slots)
        return why_no_friction(
            tracker.detector if tracker else None,
            self._fits.whole() if self._slots else {},
            moving=self._moving,
            samples=self._samples,
            rate_hz=self._samples / max(lasted_s, 1.0),
        )

    def _judge(self, slots: Slots | None) -> Iterator[MonitorEvent]:
        if slots is None:
            return
        for own in self._own:
            own.feed(slots)
        shown = motion(self.actuator, slots)
        moved = self._load.feed(slots, shown) if self._load else None
        windows, flight = self._fits.feed(slots, moved) if moved else ({}, {})
        seen = DetectorInput(slots, moved, windows, flight)
        found = {fault: tracker.detector.feed(seen) for fault, tracker in self._trackers.items()}
        moving, votes, sums = self._count(slots, moved or shown)
        self._first = int(slots.index[0]) if self._first is None else self._first
        # The first windows of a flight are not full, and their errors not comparable.
        whole = slots.index - self._first + 1 >= WINDOW_S
        end_s: Array = np.asarray(slots.index[whole] + 1, dtype=np.float64)
        estimates = {fault: of_slots.at(whole) for fault, of_slots in found.items()}
        changes: dict[int, dict[str, IndicatorChange]] = {}
        deciding = self._deciding()
        half = {fault: half_width(indicated, tail=TAIL_95) for fault, indicated in estimates.items()}
        for fault, indicated in estimates.items():
            yield from self._indicate(fault, indicated.value, half[fault], end_s)
            for k, change in self._trackers[fault].feed(indicated, end_s).items():
                # Where a network decides the friction, the physics is shown and changes nothing.
                if fault in deciding:
                    changes.setdefault(k, {})[fault] = change
        friction = _intervals(estimates["friction"], half["friction"]) if "friction" in estimates else {}
        ballots = votes[whole].astype(np.int64)
        if self._by_window:
            voted = window_outcomes(self._networks, ballots, sums[whole])
        else:
            voted = outcomes(self._networks, ballots)
        for k, change in self._tally.feed(voted, end_s.tolist()):
            if self._by_network:
                changes.setdefault(k, {})["friction"] = change
        answered = {k for k, vote in enumerate(voted) if vote and vote.severity >= 0}
        # A fault of any detector makes a window decidable, not only the friction.
        faulty = np.any(
            [tracker.exceeds(estimates[fault], half[fault]) for fault, tracker in deciding.items()], axis=0
        )
        shown_by = answered if self._by_network else friction.keys()
        self._decidable += len(shown_by | set(np.flatnonzero(faulty).tolist()))
        for k, (end, fraction, vote) in enumerate(
            zip(end_s.tolist(), moving[whole].tolist(), voted, strict=True)
        ):
            changed = [*self._changed(changes.get(k, {}), end)]
            yield self._window(end, fraction, friction.get(k), vote)
            yield from changed

    def _count(self, slots: Slots, moved: Motion) -> tuple[Array, Array, Array]:
        """Count moving samples and votes; return the windows' moving fractions, ballots and sums."""
        counts = np.zeros((slots.index.size, 2))
        counts[:, 0] = slots.count()
        ballots = np.zeros((slots.index.size, VOTE_COLUMNS))
        own = np.zeros((slots.index.size, SUMS))
        counts[:, 1] = slots.sums(moved.moving[:, None].astype(np.float64))[:, 0]
        if self._networks:
            bounds = np.cumsum([0, *counts[:, 1]]).astype(np.int64)
            inputs = network_inputs(moved.values, moved.angles)[moved.moving]
            ballots = count_votes(self._networks, inputs, bounds).astype(float)
            self._tally.count(ballots)
            if self._by_window:
                own = window_sums(self.actuator, slots, moved)
        self._slots += slots.index.size
        self._samples += int(counts[:, 0].sum())
        self._moving += int(counts[:, 1].sum())
        samples, moving = self._counts.feed(slots.index, counts).sum(axis=1).T
        return moving / samples, self._votes.feed(slots.index, ballots), self._sums.feed(slots.index, own)

    def _indicate(self, fault: str, value: Array, half: Array, end_s: Array) -> Iterator[Indication]:
        shown = np.isfinite(value)
        if shown.any():
            value, half = value[shown], half[shown]
            yield Indication(
                self.vehicle, self.actuator.name, fault, end_s[shown], value, value - half, value + half
            )

    def _changed(self, changes: Mapping[str, IndicatorChange], end_s: float) -> Iterator[ConditionChanged]:
        """Process the detectors' changes, by fault; report a change of the actuator's condition."""
        for fault, change in changes.items():
            if changed := self._held.take(fault, change, end_s):
                yield changed

    def _window(
        self, end_s: float, moving: float, friction: Interval | None, vote: VoteOutcome | None
    ) -> Window:
        self._windows += 1
        if friction is not None:
            self._friction = friction
        start_s, name, said = end_s - WINDOW_S, self.actuator.name, self._held.condition
        answer = (vote.said, vote.probability, vote.p_fault) if vote else ()
        return Window(self.vehicle, name, start_s, end_s, moving, friction, said, *answer)


def _intervals(own: Estimates, half: Array) -> dict[int, Interval]:
    """Return the intervals of this half width of the windows with evidence, by window."""
    return {
        k: Interval.around(float(own.value[k]), float(half[k]))
        for k in np.flatnonzero(np.isfinite(own.value)).tolist()
    }
