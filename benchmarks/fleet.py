"""Speed of the fleet commands: ``python benchmarks/fleet.py [--logs N] [--rows N]``.

Logs per second in a plain loop, with one worker and with two; a landing after few and after many flights; and
the questions `worst` and one aircraft's verdicts, of a store with verdicts that were made, not flown.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa
from deltalake import write_deltalake

from mavhums import Options, analyse, fleet
from mavhums.fleet.tables import schemas
from mavhums.history.files import keep_assessment
from mavhums.history.index import IndexedFolder
from mavhums_sim import Flight, fly, write_tlog

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.fleet_logs import moved
from tests.flights import START, flown, shown, verdict, write_wear

LANDINGS = (10, 1_000, 10_000)
AIRCRAFT = 200


def seconds(do: Callable[[], object]) -> float:
    begun = time.perf_counter()
    do()
    return time.perf_counter() - begun


def fly_fleet(folder: Path, count: int) -> list[Path]:
    """Write logs of two minutes, flown five times and moved in time."""
    kinds = []
    for seed in range(5):
        path = folder / f"kind-{seed}.tlog"
        write_tlog(fly(Flight(seed=seed, duration_s=120.0, rate_hz=50.0, tiers=("instrumented",))), path)
        kinds.append(path.read_bytes())
        path.unlink()
    for number in range(count):
        path = folder / f"aircraft-{number % 10}" / f"{number:05}.tlog"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(moved(kinds[number % 5], 3600.0 * number))
    return sorted(folder.rglob("*.tlog"))


def scans(folder: Path, count: int) -> None:
    logs = fly_fleet(folder, count)
    size = sum(log.stat().st_size for log in logs) / len(logs) / 1e6
    print(f"{len(logs)} logs of {size:.2f} MB")
    loop = seconds(lambda: [analyse(log, Options()) for log in logs])
    print(f"plain loop: {len(logs) / loop:.1f} logs/s")
    for workers in (1, 2):
        options = fleet.ScanOptions(aircraft="folder", workers=workers)
        store = folder / f"store-{workers}"
        took = seconds(lambda store=store, options=options: fleet.scan([folder], store, options))
        print(f"{workers} workers, start and second pass included: {len(logs) / took:.1f} logs/s")
    took = seconds(lambda: fleet.scan([folder], store, options))
    print(f"the same again, nothing new: {took:.2f} s")


def landings(folder: Path) -> None:
    for count in LANDINGS:
        history = folder / str(count)
        write_wear(history, flights=count, growth=[("elevator", 0.0), ("rudder", 0.0)])
        IndexedFolder(history)
        keep_assessment(flown(verdict(shown(0.2)), day=20_000), history)
        after = START + timedelta(days=20_001)
        took = seconds(lambda history=history, after=after: IndexedFolder(history).baselines("paper", after))
        print(f"landing after {count} flights: {took:.3f} s")


def questions(folder: Path, rows: int) -> None:
    rng = np.random.default_rng(1)
    each = rows // AIRCRAFT // 4
    for first in range(0, AIRCRAFT, 20):
        names = [f"D-{number:03}" for number in range(first, first + 20)]
        count = 20 * each * 4
        start = np.tile(np.repeat(np.arange(each) * 3_600_000_000, 4), 20)
        friction = rng.normal(0.225, 0.003, count)
        table = pa.table(
            {
                "aircraft": np.repeat(names, each * 4),
                "path": [f"{name}/{k}.tlog" for name in names for k in range(each) for _ in range(4)],
                "sha256": ["0"] * count,
                "start_us": start,
                "vehicle": np.ones(count, dtype=np.int64),
                "actuator": np.tile(["a", "b", "c", "d"], 20 * each),
                "condition": ["normal"] * count,
                "worst": ["normal"] * count,
                "urgency": np.zeros(count),
                "friction_nm": friction,
                "airframe": ["paper"] * count,
                "verdict": [verdict(shown(0.2)).model_dump_json()] * count,
            }
        )
        write_deltalake(folder / "verdicts", table, mode="append")
        write_deltalake(folder / "logs", _no_logs(), mode="append")
    print(f"worst of {rows} verdicts: {seconds(lambda: fleet.worst(folder, most=20)):.2f} s")
    print(f"one aircraft's verdicts of them: {seconds(lambda: fleet.verdicts(folder, 'D-007')):.2f} s")


def _no_logs() -> pa.Table:
    return schemas()["logs"].empty_table()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=600)
    parser.add_argument("--rows", type=int, default=1_000_000)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        landings(Path(one))
        questions(Path(two), given.rows)
    with tempfile.TemporaryDirectory() as folder:
        scans(Path(folder), given.logs)


if __name__ == "__main__":
    main()
