"""One by one and fleet, the same verdicts: ``python benchmarks/fleet_equality.py [--flights N]``.

Flies twelve aircraft, fifty flights each: on six the elevator wears, two have two vehicles in each log, one
is repaired half-way, one log in a hundred is broken. Every log is judged by ``analyse --keep``
after its landing, and by a fleet with one worker, with two, in shuffled order of arrival, in PostgreSQL, and
through a scheduler that is a process of its own; two aircraft once more with another rate of false alarms.
Prints how many logs agree.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

from dask import config
from distributed import Security

from mavhums import MavhumsError, Options, analyse, fleet
from mavhums_sim import Flight, fly, write_tlog
from tests.fleet.stores import postgres
from tests.fleet_logs import joined, moved

AIRCRAFT = 12
WORN = range(6)
TWO_VEHICLES = (10, 11)
REPAIRED = 2
DAY_S = 86_400.0
FIRST_DAY = datetime(2026, 1, 1, tzinfo=UTC)  # of the simulator

VerdictTexts = dict[str, list[str]]


def fly_all(folder: Path, flights: int) -> None:
    rng = random.Random(1)
    for aircraft in range(AIRCRAFT):
        place = folder / f"D-{aircraft:03d}"
        place.mkdir(parents=True)
        for day in range(flights):
            path = place / f"{day:03d}.tlog"
            wear = 0.15 * day / flights if aircraft in WORN else 0.0
            if aircraft == REPAIRED and day >= flights // 2:
                wear = 0.0
            data = _flown(folder, 1000 * aircraft + day, aircraft, 0.225 + wear, rng.uniform(22.0, 40.0))
            if aircraft in TWO_VEHICLES:
                data = joined(_flown(folder, 500_000 + day, 100 + aircraft, 0.225, 22.0), data)
            path.write_bytes(data if rng.random() > 0.01 else data[:40])
            path.write_bytes(moved(path.read_bytes(), DAY_S * day) if path.stat().st_size > 40 else b"broken")


def _flown(folder: Path, seed: int, individual: int, friction_nm: float, duration_s: float) -> bytes:
    flight = Flight(
        seed,
        duration_s,
        {"elevator": (friction_nm, friction_nm)},
        rate_hz=25.0,
        tiers=("instrumented",),
        individuals=individual,
    )
    write_tlog(fly(flight), folder / "flown")
    return (folder / "flown").read_bytes()


def repair(flights: int) -> fleet.Repair:
    return fleet.Repair(f"D-{REPAIRED:03d}", None, FIRST_DAY + timedelta(days=flights // 2))


def one_by_one(logs: Path, store: Path, flights: int, rate: float, aircraft: Sequence[int]) -> VerdictTexts:
    """Judge and keep each log after its landing."""
    verdicts: VerdictTexts = {}
    for number in aircraft:
        options = Options(store=store, aircraft="folder", false_alarms=rate, keep=True)
        for log in sorted((logs / f"D-{number:03d}").iterdir()):
            if number == REPAIRED and int(log.stem) == max(flights // 2, 1):  # the store knows it by then
                fleet.change_repairs(store, add=[repair(flights)])
            try:
                assessment = analyse(log, options)
            except MavhumsError:
                continue
            verdicts[str(log)] = sorted(verdict.model_dump_json() for verdict in assessment.verdicts)
    return verdicts


def by_fleet(
    logs: Sequence[Path], store: str | Path, flights: int, *, rate: float = 1.0, parts: int = 1, **how: object
) -> VerdictTexts:
    """Judge the logs in the given order of arrival."""
    judging = Options(false_alarms=rate, aircraft="folder")
    options = fleet.ScanOptions(judging=judging, **how)  # type: ignore[arg-type]
    for part in range(parts):
        fleet.scan(logs[part::parts], store, options)
        fleet.change_repairs(store, add=[repair(flights)])
    verdicts: VerdictTexts = {}
    for aircraft in range(AIRCRAFT):
        for log, verdict in fleet.verdicts(store, f"D-{aircraft:03d}"):
            verdicts.setdefault(log, []).append(verdict.model_dump_json())
    return {log: sorted(several) for log, several in verdicts.items()}


@contextmanager
def cluster(folder: Path) -> Iterator[str]:
    """Run a scheduler and two workers, each a process of its own, with a certificate for all."""
    own, key, cert = Security.temporary(), folder / "key.pem", folder / "cert.pem"
    key.write_text(own.tls_client_key)
    cert.write_text(own.tls_client_cert)
    tls = ["--tls-ca-file", str(cert), "--tls-cert", str(cert), "--tls-key", str(key)]
    dask, file = str(Path(sys.executable).parent / "dask"), folder / "scheduler.json"
    scheduler = [dask, "scheduler", "--protocol", "tls", "--port", "0", "--no-dashboard", *tls]
    scheduler += ["--scheduler-file", str(file)]
    worker = [dask, "worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-dashboard", *tls]
    quiet = subprocess.DEVNULL
    processes = [subprocess.Popen(scheduler, stdout=quiet, stderr=quiet)]
    try:
        while not file.exists():
            time.sleep(0.1)
        processes += [subprocess.Popen(worker, cwd=folder, stdout=quiet, stderr=quiet) for _ in range(2)]
        settings = {"ca-file": str(cert), "client.cert": str(cert), "client.key": str(key)}
        with config.set({f"distributed.comm.tls.{name}": value for name, value in settings.items()}):
            yield str(json.loads(file.read_text(encoding="utf-8"))["address"])
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


def compare(name: str, expected: VerdictTexts, found: VerdictTexts, begun_s: float) -> bool:
    same = sum(found.get(log) == verdicts for log, verdicts in expected.items())
    more = len(found.keys() - expected.keys())
    took_s = time.perf_counter() - begun_s
    print(f"{name}: {same} of {len(expected)} logs agree, {more} more; {took_s:.0f} s", flush=True)
    return same == len(expected) and not more


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=50, help="flights of each aircraft")
    flights = parser.parse_args().flights
    agree = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        begun = time.perf_counter()
        fly_all(folder / "logs", flights)
        for left in ("flown", "other"):
            (folder / "logs" / left).unlink(missing_ok=True)
        logs = sorted((folder / "logs").rglob("*.tlog"))
        print(
            f"{len(logs)} logs of {AIRCRAFT} aircraft flown; {time.perf_counter() - begun:.0f} s", flush=True
        )
        begun = time.perf_counter()
        expected = one_by_one(folder / "logs", folder / "store", flights, 1.0, range(AIRCRAFT))
        drifts = sum("drift" in verdict for several in expected.values() for verdict in several)
        print(f"one by one: {len(expected)} judged, {drifts} verdicts with drift evidence", end="; ")
        print(f"{time.perf_counter() - begun:.0f} s", flush=True)
        for workers in (1, 2):
            begun = time.perf_counter()
            found = by_fleet(logs, folder / f"store-{workers}", flights, workers=workers)
            agree.append(compare(f"fleet, {workers} workers", expected, found, begun))
        begun = time.perf_counter()
        arriving = random.Random(2).sample(logs, len(logs))
        scans = min(5, flights)  # the first one must know the aircraft of a repair
        found = by_fleet(arriving, folder / "store-shuffled", flights, parts=scans, workers=2)
        agree.append(compare(f"fleet, shuffled, in {scans} scans", expected, found, begun))
        begun = time.perf_counter()
        with postgres() as server:
            found = by_fleet(arriving, server, flights, parts=scans, workers=2)
        agree.append(compare("the same in PostgreSQL", expected, found, begun))
        begun = time.perf_counter()
        with cluster(folder) as scheduler:
            found = by_fleet(logs, folder / "store-scheduler", flights, scheduler=scheduler)
        agree.append(compare("fleet, a scheduler of its own", expected, found, begun))
        begun = time.perf_counter()
        pair = (REPAIRED, TWO_VEHICLES[0])
        some = [log for log in logs if int(log.parent.name.removeprefix("D-")) in pair]
        expected = one_by_one(folder / "logs", folder / "store-one-rate", flights, 20.0, pair)
        found = by_fleet(some, folder / "store-rate", flights, rate=20.0, workers=2)
        agree.append(compare("20 false alarms per 100 hours", expected, found, begun))
    sys.exit(0 if all(agree) else 1)


if __name__ == "__main__":
    main()
