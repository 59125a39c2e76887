"""False alarms of the axes where the log is changed and the flight is not.

    python benchmarks/perturbed.py [FOLDER ...] [--only REGEX] [--simulated HOURS] [--simulated-seed N]
                                   [--kinds REGEX] [--seeds A-B] [--jobs J] [--keep FILE]

FOLDER holds flights and a ``labels.csv`` (``benchmarks/alfa.py``); those without a fault are used, and with
``--confounded`` those in which something other than a surface fails. ``--simulated`` adds flights in closed
loop (``benchmarks/_closed_loop.py``). Each flight is changed in each way of ``mavhums_sim.perturb``, once a
seed: the parameters come late, twice, half at first, or never; the beginning is cut off, at 17 places or
more; bytes are damaged.
An alarm is a change of an axis to degraded or emergency, even if it is withdrawn later. The rate counts logs
with an alarm per 100 h of forward flight, with its 95 % upper bound (Poisson). ``--keep FILE`` writes each
result as it comes and takes from it what a former run has done.
"""

from __future__ import annotations

import argparse
import json
import re
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

from scipy.stats import chi2

from benchmarks._closed_loop import healthy
from benchmarks._flown_faults import Flight, judge_bytes, read_labels
from mavhums_sim.perturb import KINDS, perturb

_SURE = 0.95
_UNCHANGED = "unchanged"
_BEGINNINGS = 17  # of a flight, at least


@dataclass(frozen=True, slots=True)
class Case:
    """One changed log: a file, or a simulated flight by its number, and what is done to it."""

    source: str
    number: int
    kind: str
    seed: int

    @property
    def name(self) -> str:
        """The name of the flight."""
        return Path(self.source).name if self.number < 0 else f"{self.source} {self.number}"


@cache
def _content(source: str, number: int) -> bytes:
    """Return the bytes of a flight; the last one is kept."""
    if number < 0:
        return Path(source).read_bytes()
    hours, seed = source.split()[1:]
    return [*healthy(float(hours), int(seed))][number].fly().tlog


def judge(case: Case) -> dict[str, object]:
    """Return the case with its alarms, conditions and seconds flown."""
    content = _content(case.source, case.number)
    if case.kind != _UNCHANGED:
        content = perturb(content, case.kind, case.seed)
    blocks = [content[at : at + (1 << 20)] for at in range(0, len(content), 1 << 20)]
    outcome = judge_bytes(Flight(Path(case.name)), blocks, None)
    alarms = [f"{a.actuator} {a.fault} {a.after} at {a.time_s:.0f} s" for a in outcome.alarms]
    judged = {axis: seconds for axis, (seconds, _) in outcome.judged.items()}
    return asdict(case) | {
        "alarms": alarms,
        "conditions": outcome.conditions,
        "judged": judged,
        "flown_s": outcome.flown_s,
    }


def _cases(arguments: argparse.Namespace) -> Iterator[list[Case]]:
    """Yield the cases of each flight."""
    sources = []
    for folder in arguments.folders:
        for flight in read_labels(folder):
            sound = all(arguments.confounded and fault.confounds for fault in flight.faults)
            if sound and flight.path.suffix == ".tlog" and re.search(arguments.only, flight.path.name):
                sources.append((str(flight.path), -1))
    count = len([*healthy(arguments.simulated)])
    sources += [(f"simulated {arguments.simulated:g} {arguments.simulated_seed}", k) for k in range(count)]
    first, last = (int(number) for number in arguments.seeds.split("-"))
    kinds = [kind for kind in (_UNCHANGED, *KINDS) if re.search(arguments.kinds, kind)]
    for source in sources:
        yield [
            Case(*source, kind, seed) for kind in kinds for seed in range(first, _last(kind, first, last) + 1)
        ]


def _last(kind: str, first: int, last: int) -> int:
    """Return the last seed of a kind: each place at which a log begins is another reference."""
    if kind in (_UNCHANGED, "parameters absent"):
        return first
    return max(last, first + _BEGINNINGS - 1) if kind.startswith("beginning cut") else last


def _judge_all(cases: list[Case]) -> list[dict[str, object]]:
    found = [judge(case) for case in cases]
    _content.cache_clear()
    return found


def main() -> None:
    """Judge and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="*")
    parser.add_argument("--only", default="", help="flights whose file name matches")
    parser.add_argument("--confounded", action="store_true", help="also flights with another failure")
    parser.add_argument("--simulated", type=float, default=0.0, metavar="HOURS")
    parser.add_argument("--simulated-seed", type=int, default=0)
    parser.add_argument("--kinds", default="")
    parser.add_argument("--seeds", default="0-4")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", type=Path, default=None)
    arguments = parser.parse_args()
    known = {}
    if arguments.keep and arguments.keep.exists():
        rows = [json.loads(line) for line in arguments.keep.read_text().splitlines()]
        known = {(r["source"], r["number"], r["kind"], r["seed"]): r for r in rows}
    every = [[*cases] for cases in _cases(arguments)]
    left = [[c for c in cases if (c.source, c.number, c.kind, c.seed) not in known] for cases in every]
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for found in pool.map(_judge_all, [cases for cases in left if cases]):
            for row in found:
                known[row["source"], row["number"], row["kind"], row["seed"]] = row
                if arguments.keep:
                    with arguments.keep.open("a") as file:
                        file.write(json.dumps(row) + "\n")
    _print([known[c.source, c.number, c.kind, c.seed] for cases in every for c in cases])


def _print(rows: list[dict[str, object]]) -> None:
    groups: dict[str, list[dict[str, object]]] = defaultdict(list)
    for row in rows:
        groups[str(row["kind"])].append(row)
    for kind, group in (*groups.items(), ("all changed", [r for r in rows if r["kind"] != _UNCHANGED])):
        hours = sum(float(str(row["flown_s"])) for row in group) / 3600
        alarmed = [row for row in group if row["alarms"]]
        bound = chi2.ppf(_SURE, 2 * (len(alarmed) + 1)) / 2
        per = 100 / hours if hours else float("nan")
        rate = f"{per * len(alarmed):.1f} per 100 h (95 %: below {per * bound:.1f})"
        print(f"{kind}: {len(alarmed)} of {len(group)} logs with an alarm, {hours:.1f} h, {rate}")
        if kind == "all changed":
            continue
        for row in alarmed:
            name = Case(str(row["source"]), int(str(row["number"])), kind, int(str(row["seed"]))).name
            print(f"    {name}, seed {row['seed']}: {'; '.join(map(str, row['alarms']))}")  # type: ignore[call-overload]


if __name__ == "__main__":
    main()
