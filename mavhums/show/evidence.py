"""The evidence of a flight, subject by subject: what a report and the page draw."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mavhums.results.assessment import Assessment
from mavhums.results.sections import AxisLimits
from mavhums.results.verdict import ALL, Verdict
from mavhums.show.html_curves import Curve, Gathered, Key
from mavhums.show.words import clock, name, percent

__all__ = ["Evidence", "Limit", "evidence"]

_PLOTS = 24
_ATTITUDES = {"tracking": "", "hard_over": "roll"}
"""The axis whose demanded and flown angle show a fault; empty for the verdict's own."""


class Limit(NamedTuple):
    """A level that a curve is compared with."""

    value: float
    name: str

    @property
    def label(self) -> str:
        """The word that stands beside the curve, where there is room for one."""
        return self.name.split()[0]


class Evidence(NamedTuple):
    """A curve with its words.

    Attributes
    ----------
    vehicle
        Whose flight modes stand below it.
    told
        What the curve shows, for who does not see it.
    since_s
        Onset of what is wrong; None where nothing is.
    """

    vehicle: int
    title: str
    told: str
    curve: Curve
    limits: tuple[Limit, ...] = ()
    since_s: float | None = None


def evidence(assessment: Assessment, gathered: Gathered) -> Iterator[Evidence]:
    """Yield the evidence of each subject, the worst first: what raised an alarm, friction, effectiveness."""
    curves, attitudes, networks = gathered.curves(), gathered.attitudes(), gathered.networks()
    drawn = 0
    for verdict in assessment.ranked():
        if verdict.vehicle is None or verdict.actuator == ALL:
            continue
        suspects = [item.fault for item in verdict.suspects]
        for axis in dict.fromkeys(
            _ATTITUDES[fault] or verdict.actuator for fault in suspects if fault in _ATTITUDES
        ):
            flown = attitudes.get((verdict.vehicle, axis))
            if flown is not None and drawn < _PLOTS:
                drawn += 1
                yield _attitude(verdict, axis, flown, assessment)
        alarms = [item.kind.removesuffix("_drift") for item in verdict.evidence]
        for fault in dict.fromkeys((*suspects, *alarms, "friction", "effectiveness")):
            curve = curves.get(Key(verdict.vehicle, verdict.actuator, fault))
            if curve is None or not curve.time_s.size or drawn == _PLOTS:
                continue
            drawn += 1
            what, limits = _limits(verdict, fault)
            since_s = verdict.since.flight_time_s if verdict.since and suspects else None
            last = curve.rows[-1]
            told = (
                f"{what}: {last[1]:.3g} at the end (95 % interval {last[0]:.3g} to {last[2]:.3g}), "
                f"highest {curve.rows[:, 1].max():.3g}, lowest {curve.rows[:, 1].min():.3g}"
            )
            bounds = "; ".join(f"{limit.name} {limit.value:.3g}" for limit in limits)
            title = f"{name(verdict, assessment)}: {what}"
            told = f"{told}; {bounds}" if bounds else told
            yield Evidence(verdict.vehicle, title, told, curve, limits, since_s)
        said = networks.get((verdict.vehicle, verdict.actuator))
        if said is not None and drawn < _PLOTS:
            drawn += 1
            yield _network(verdict, said, assessment)


def _network(verdict: Verdict, said: Curve, assessment: Assessment) -> Evidence:
    """Return the network's answer over the flight, as the paper's figures 16 to 19 show it."""
    network = verdict.network.model.name if verdict.network else "the network"
    told = "probability of an emergency; thick: ten seconds, at their middle; thin: each sample inside the"
    told += " training range"
    if verdict.network and verdict.network.share_of_samples is not None:
        told += f"; it calls {percent(verdict.network.share_of_samples)} of those in motion an emergency"
    assert verdict.vehicle is not None
    title = f"{name(verdict, assessment)}: {network} on each sample"
    return Evidence(verdict.vehicle, title, told, said, (Limit(0.5, "emergency above"),))


def _attitude(verdict: Verdict, axis: str, curve: Curve, assessment: Assessment) -> Evidence:
    """Return the demanded and the flown angle about an axis, which a tracking or hard-over alarm rests on."""
    since_s = verdict.since.flight_time_s if verdict.since else None
    assert verdict.vehicle is not None
    assert curve.demanded is not None
    apart = np.abs(curve.rows[:, 1] - curve.demanded)
    told = f"{axis} angle, °: solid flown, dashed demanded"
    if np.isfinite(apart).any():
        worst = int(np.nanargmax(apart))
        told += f"; farthest apart by {apart[worst]:.0f}° at {clock(float(curve.time_s[worst]))}"
    title = f"{name(verdict, assessment)}: demanded and flown {axis} angle, °"
    return Evidence(verdict.vehicle, title, told, curve, since_s=since_s)


def _limits(verdict: Verdict, fault: str) -> tuple[str, tuple[Limit, ...]]:
    """Return what a curve shows, with its unit, and the levels that it is compared with."""
    if fault == "effectiveness":
        reference = Limit(1.0, "reference")
        known = verdict.limits or AxisLimits()
        degraded = Limit(known.effectiveness_degraded, "degraded below")
        emergency = Limit(known.effectiveness_emergency, "emergency up to")
        return "control effectiveness, share of the reference", (reference, degraded, emergency)
    found = next((item for item in verdict.indicators if item.fault == fault), None)
    if found is None:
        return fault.replace("_", " "), ()
    levels = [(found.limit, "degraded above"), (found.emergency, "emergency from")]
    unit = "" if found.unit == "1" else f", {found.unit}"
    return f"{found.quantity}{unit}", tuple(Limit(value, word) for value, word in levels if value is not None)
