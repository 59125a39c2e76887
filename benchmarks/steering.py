"""Faults of the steering of simulated rovers and boats that are found, and false alarms.

    python -m benchmarks.steering --drives 30 --hours 10 --seed 1

Each drive is its own vehicle, ground or water and route, through the whole program: its log's bytes go in,
its changes of condition come out. A fault comes at 200 to 320 s of 520 s; a healthy drive lasts 600 s.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.motors import share
from mavhums.engine.engine import Engine
from mavhums.health.decision.events import ConditionChanged
from mavhums_sim.rover import SteeringFault, draw_rover, drive, encoded

HZ = (4.0, 10.0, 25.0)
FAULTS = {"−50 %": (0.5, False), "no motion": (0.0, False), "frozen": (1.0, True)}
_REST_S = 15.0


class Case(NamedTuple):
    """One drive, and what was said of it: when and what first, and the condition at its end."""

    boat: bool
    hz: float
    fault: str
    fault_s: float
    alarm_s: float
    kind: str
    rule: str
    condition: str
    seed: int


def case(seed: int, fault: str, seconds: float) -> Case:
    """Drive and judge."""
    rng = np.random.default_rng([seed, 1])
    boat, hz = bool(rng.random() < 0.4), float(rng.choice(HZ))
    failed = SteeringFault()
    if fault:
        left, frozen = FAULTS[fault]
        failed = SteeringFault(rng.uniform(200, 320), left, frozen)
    driven = drive(draw_rover(rng, boat=boat), seconds, seed, failed)
    engine = Engine()
    events = [*engine.feed(encoded(driven, hz, seed)), *engine.finish()]
    alarms = [e for e in events if isinstance(e, ConditionChanged) and e.after in ("degraded", "emergency")]
    [verdict] = [v for v in engine.assessment().verdicts if v.subject == "axis"]
    first = alarms[0] if alarms else None
    return Case(
        boat, hz, fault, failed.start_s + _REST_S, first.time_s if first else np.nan,
        first.fault if first else "", first.rule if first else "", verdict.condition, seed,
    )  # fmt: skip


def report(cases: Sequence[Case]) -> None:
    """Print what was found, and the false alarms."""
    print("| fault | vehicle | 10, 30, 60 s, to the end; median, s |")
    print("|---|---|---|")
    for fault in FAULTS:
        for boat in (False, True):
            own = [c for c in cases if c.fault == fault and c.boat == boat]
            late = np.array([c.alarm_s - c.fault_s for c in own])
            right = late[late >= 0]
            within = ", ".join(str((right <= limit).sum()) for limit in (10, 30, 60, 1e9))
            median = f"; {np.median(right):.0f}" if right.size else ""
            cell = f"{within} of {len(own)}{median}" if own else "–"
            print(f"| {fault} | {'boat' if boat else 'rover'} | {cell} |")
    faulty = [c for c in cases if c.fault]
    early, undecided = (
        sum(c.alarm_s < c.fault_s for c in faulty),
        sum(c.condition == "undecided" for c in faulty),
    )
    print(f"\nbefore the onset {early}, undecided at the end {undecided}, of {len(faulty)}")
    healthy = [c for c in cases if not c.fault]
    hours = 600 * len(healthy) / 3600
    false = [c for c in healthy if c.kind]
    normal = sum(c.condition == "normal" for c in healthy)
    print(f"\n{len(false)} false alarms in {hours:.1f} h; normal {share(normal, len(healthy))}")
    for c in false[:40]:
        print("   ", c)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--drives", type=int, default=10, help="with each fault")
    parser.add_argument("--hours", type=float, default=2.0, help="of healthy driving")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    first, cases = options.seed * 100_000, []
    for k, fault in enumerate(FAULTS):
        cases += [case(first + 10_000 * (k + 1) + n, fault, 520.0) for n in range(options.drives)]
    cases += [case(first + n, "", 600.0) for n in range(int(options.hours * 6))]
    report(cases)


if __name__ == "__main__":
    main()
