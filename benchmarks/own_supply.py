"""A weak supply of a servo without a data sheet, by its own flights: ``python benchmarks/own_supply.py``.

Flights of 100 s by an individual two-mass aircraft (``--aircraft``), five flight modes in turn, without a
data sheet: command and angle alone. The rule was set on aircraft 33. In brackets: a flight's own error counts
however large it is.
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from dataclasses import replace

from benchmarks._fleet import MODES
from benchmarks._own_flights import TIERS, Task, flown
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.estimation.wear import shows
from mavhums.health.self_baseline.comparison import compare

NAMES = ("position, 50 Hz", "position, 25 Hz")
LOST_V = (0.0, 14.0, 18.0, 20.0, 22.0, 24.0)
_BASELINE = 25  # flights; at 25 Hz some show nothing


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--aircraft", type=int, default=35)
    parser.add_argument("--each", type=int, default=1, help="flights of each mode and voltage lost")
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args()
    air = (args.aircraft,)
    tasks = [Task("base", k, "friction", 0.0, air, NAMES) for k in range(_BASELINE)]
    tasks += [
        Task(f"{lost:g} V", 5000 + 100 * n + k, "supply_sag" if lost else "friction", lost, air, NAMES)
        for n, lost in enumerate(LOST_V)
        for k in range(args.each * len(MODES))
    ]
    past: dict[tuple[object, str], list[PastRecord]] = defaultdict(list)
    said: Counter[tuple[str, str, str, bool, str]] = Counter()
    for row in flown(tasks, args.workers):
        known = past[row.actuator, row.tier]
        if row.kind == "base":
            if row.record is not None and shows(row.record):
                known.append(PastRecord((row.record,), "2026-01-01", True))
            continue
        for blurs in (True, False):
            equation = replace(TIERS[row.tier].equation, blurs=blurs)
            found = compare(equation, row.record, known).condition if row.record else "undecided"
            said[row.tier, row.kind, MODES[row.number % len(MODES)], blurs, found] += 1
    for name in NAMES:
        print(f"\n| {name}; lost | {' | '.join(MODES)} |")
        print("|---" * (len(MODES) + 1) + "|")
        for lost in LOST_V:
            cells = []
            for mode in MODES:
                now, before = (said[name, f"{lost:g} V", mode, blurs, "changed"] for blurs in (True, False))
                cells.append(f"{now} ({before}) of {4 * args.each}")
            print(f"| {lost:g} V | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
