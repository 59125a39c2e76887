"""A scan, a digest and the page on one store, killed at random: ``python benchmarks/fleet_kills.py``.

Logs land one by one. After each a scan, a digest and a question to the page run together, and some of their
processes are killed (SIGKILL) at a random time. In the end one scan runs whole, and the store is compared
with one that nothing killed.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
from mavhums_sim import Flight, fly, write_dataflash
from tests.serve.browser import Served, served

AIRCRAFT = 3
MOST_S = 4.0


def mavhums(*arguments: object) -> subprocess.Popen[str]:
    """Start a command."""
    command = [sys.executable, "-m", "mavhums", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def asked(page: Served) -> bool:
    """Return whether the page tells the worst of the store."""
    try:
        with urllib.request.urlopen(f"{page.url}/api/fleet/worst", timeout=60) as answer:
            return isinstance(json.load(answer), list)
    except OSError:
        return False


def scan(logs: Path, store: Path) -> tuple[object, ...]:
    return "fleet", "scan", logs, "--to", store, "--aircraft", "folder", "--workers", 0, "--airframe", "paper"


def told(store: Path) -> Any:
    """Return what a store says of its actuators, without the paths of the logs."""
    found = mavhums("fleet", "worst", store, "--json", "-n", 1000)
    rows = json.loads(found.communicate()[0])
    for row in rows:
        row["log"] = Path(row["log"]).name
    return sorted(rows, key=lambda row: (row["aircraft"], row["log"], row["verdict"]["actuator"]))


def _difference(one: Any, other: Any) -> str:
    """Return the first place where two objects differ."""
    if isinstance(one, dict) and isinstance(other, dict):
        differ = [key for key in {**one, **other} if one.get(key) != other.get(key)]
        return f".{differ[0]}{_difference(one.get(differ[0]), other.get(differ[0]))}"
    return f": {one} and {other}"


def main() -> None:
    """Kill, and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--landings", type=int, default=25)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    chance, counts = random.Random(args.seed), Counter[str]()
    with tempfile.TemporaryDirectory() as name:
        logs, store = Path(name, "logs"), Path(name, "store")
        for k in range(args.landings):
            folder = logs / f"D-{k % AIRCRAFT}"
            folder.mkdir(parents=True, exist_ok=True)
            friction = {"elevator": (0.2 + 0.02 * k, 0.2 + 0.02 * k)}
            flight = Flight(
                seed=k, duration_s=20.0, rate_hz=20.0, friction_nm=friction, tiers=("csrv", "pwm")
            )
            write_dataflash(fly(flight), folder / f"{k:03}.BIN", day=float(k))
            if k == 0:
                mavhums(*scan(logs, store)).communicate()
                continue
            with served(store) as page:
                running = {"scan": mavhums(*scan(logs, store)), "digest": mavhums("fleet", "digest", store)}
                counts["asked the page"] += 1
                counts["page answered"] += asked(page)
                for what, process in {**running, "page": page.process}.items():
                    if chance.random() < 0.6:
                        time.sleep(chance.uniform(0.0, MOST_S / 3))
                        if process.poll() is None:
                            process.kill()
                            counts[f"{what} killed"] += 1
                for process in running.values():
                    process.communicate()
        whole = mavhums(*scan(logs, store))
        error = whole.communicate()[1]
        counts["last scan ended"] = whole.returncode
        mavhums(*scan(logs, Path(name, "never killed"))).communicate()
        killed, spared = told(store), told(Path(name, "never killed"))
        shutil.rmtree(store)
    print(f"{args.landings} landings: {', '.join(f'{what} {n}' for what, n in sorted(counts.items()))}")
    print(
        f"the store equals one that nothing killed: {killed == spared} ({len(killed)} and {len(spared)} rows)"
    )
    for one, other in zip(killed, spared, strict=False):
        if one != other:
            print(f"{one['aircraft']} {one['log']} {one['verdict']['actuator']}: {_difference(one, other)}")
    if error:
        print(error)


if __name__ == "__main__":
    main()
