"""Verdicts over the severity of each fault: ``python benchmarks/severities.py [FAULT…] [--first 0]``.

Every fault that the simulator flies, from nothing to its end in ten steps, constant over flights of 60 s
of two-mass individuals, in each telemetry tier. A cell has a letter for every surface of every seed:
u undecided, n normal, d degraded, E emergency. A worse fault must not give a milder verdict: the last
column counts the steps at which the verdict on a surface is milder than one at a smaller severity. Seeds fly
take-off, turns and gusts in turn.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from benchmarks._fleet import MODES, SURFACES, Task, added, flight, fly_all, judge
from mavhums.core.conditions import URGENCY, Condition
from mavhums.health.actuator.monitor import ActuatorFindings
from mavhums_sim import FlightRecord
from mavhums_sim.conditions import FAULTS

STEPS = 10
TIERS = ("instrumented", "csrv", "esc-signed", "esc-unsigned")
_LETTERS = {"undecided": "u", "normal": "n", "degraded": "d", "emergency": "E"}
_AIRCRAFT = 860  # no other section flies it


def _verdicts(name: str, record: FlightRecord) -> dict[str, list[Condition]]:
    return {tier: [_gravest(one.findings) for one in judge(name, record, tier=tier)] for tier in TIERS}


def _gravest(found: ActuatorFindings) -> Condition:
    return max(found.condition, found.worst, key=URGENCY.__getitem__)


def swept(fault: str, seeds: range, args: argparse.Namespace) -> dict[str, list[list[Condition]]]:
    """Return by tier, for each step of the severity, the verdicts on all surfaces of all seeds."""
    steps = np.linspace(0.0, FAULTS[fault].gravest, STEPS + 1).tolist()
    tasks = [
        Task(
            f"{step}/{seed}",
            flight(
                seed,
                _AIRCRAFT + seed,
                rate_hz=args.rate,
                mode=args.modes[seed % len(args.modes)],
                duration_s=args.seconds,
                conditions=added(fault, severity),
            ),
        )
        for step, severity in enumerate(steps)
        for seed in seeds
    ]
    found: dict[str, list[list[Condition]]] = {tier: [[] for _ in steps] for tier in TIERS}
    for name, tiers in fly_all(tasks, _verdicts, args.workers):
        for tier, conditions in tiers.items():
            found[tier][int(name.split("/")[0])] += conditions
    return found


def milder(verdicts: list[list[Condition]]) -> int:
    """Return how often a verdict is milder than the one on the same surface at a smaller severity."""
    urgency = np.array([[URGENCY[c] for c in step] for step in verdicts])
    return int(np.count_nonzero(urgency[1:] < np.maximum.accumulate(urgency)[:-1]))


def rows(args: argparse.Namespace) -> Iterator[str]:
    for fault in args.faults or FAULTS:
        steps = np.linspace(0.0, FAULTS[fault].gravest, STEPS + 1)
        yield ""
        yield f"| {fault} | " + " | ".join(f"{step:g}" for step in steps) + " | milder |"
        yield "|---" * (STEPS + 3) + "|"
        for tier, verdicts in swept(fault, range(args.first, args.first + args.seeds), args).items():
            cells = ["".join(_LETTERS[c] for c in step) for step in verdicts]
            parts = [
                " ".join(cell[k : k + len(SURFACES)] for k in range(0, len(cell), len(SURFACES)))
                for cell in cells
            ]
            yield f"| {tier} | {' | '.join(parts)} | {milder(verdicts)} |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("faults", nargs="*", choices=[[], *FAULTS], help="all if omitted")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=50.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--modes", nargs="+", choices=MODES, default=("takeoff", "turns", "gusts"))
    for line in rows(parser.parse_args()):
        print(line, flush=True)


if __name__ == "__main__":
    main()
