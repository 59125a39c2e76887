"""Speed and memory of the fleet commands: ``python benchmarks/fleet.py [PART ...]``, parts as below.

Seconds are of the wall and of the processors together (this process and its workers); where other work is on
the machine, the processors' are the ones to trust. The load is printed first.

scans      logs per second in a plain loop, with one worker and with two
memory     largest memory of driver and worker while they scan 100 and 2,000 logs
growth     ten new logs into a store of 10,000
questions  what the page and the commands ask, of 1,000,000 verdicts
stored     one more flight in a store with 10, 600 and 10,000 of its aircraft; then a late log, for which
           all of them are compared again
unlimited  the same of an aircraft without a data sheet, whose earlier flights were not compared
many       `analyse` of many logs by one process and by two
"""

from __future__ import annotations

import argparse
import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import psutil

from mavhums import Options, analyse, analyse_many, fleet
from mavhums.actuator.profile import Airframe, load_airframe
from mavhums.app.analysis import Batch, analyse_alone
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.queries import exit_code, flight
from mavhums.flights.queries import flights as all_flights
from mavhums.flights.store import Store
from mavhums.flights.store.tables import METADATA
from mavhums.serve.views import aircraft_table
from mavhums_sim import Flight, fly, write_tlog
from tests.fleet.stores import add, row_of
from tests.fleet_logs import moved

LANDINGS = (10, 600, 10_000)
AIRCRAFT = 200
VERDICTS = 1_000_000
DAY_S = 86_400.0


@contextmanager
def timed(what: str, count: int = 1, unit: str = "") -> Iterator[None]:
    """Print how long a part took, and how many there were each second."""
    with watched() as used:
        wall_s = time.perf_counter()
        yield
        wall_s = time.perf_counter() - wall_s
    cpu_s = used.processor_s
    rate = f", {count / wall_s:.1f} {unit}/s, {1e3 * cpu_s / count:.0f} ms of processor each" if unit else ""
    print(f"{what}: {wall_s:.2f} s, {cpu_s:.2f} s of processor{rate}", flush=True)


@dataclass
class Used:
    """What this process and its children used; memory is the largest unshared one, MB."""

    driver_mb: float = 0.0
    worker_mb: float = 0.0
    processor_s: float = 0.0


@contextmanager
def watched() -> Iterator[Used]:
    """Look at this process and its children five times a second; workers are not always waited for."""
    here, used, ended = psutil.Process(), Used(), threading.Event()
    begun_s = time.process_time()
    workers_s: dict[psutil.Process, float] = {}

    def watch() -> None:
        while not ended.wait(0.2):
            used.driver_mb = max(used.driver_mb, here.memory_full_info().uss / 1e6)
            for child in here.children(recursive=True):
                try:
                    used.worker_mb = max(used.worker_mb, child.memory_full_info().uss / 1e6)
                    times = child.cpu_times()
                except psutil.Error:
                    continue
                workers_s[child] = times.user + times.system

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield used
    finally:
        ended.set()
        thread.join()
        used.processor_s = time.process_time() - begun_s + sum(workers_s.values())


def kinds(folder: Path, duration_s: float) -> list[bytes]:
    """Return three different logs."""
    logs = []
    for seed in range(3):
        flight = Flight(seed=seed, duration_s=duration_s, rate_hz=50.0, tiers=("instrumented",))
        write_tlog(fly(flight), folder / "kind")
        logs.append((folder / "kind").read_bytes())
    (folder / "kind").unlink()
    return logs


def scans(folder: Path) -> None:
    made = kinds(folder, 120.0)
    logs = [folder / f"D-{number % 10}" / f"{number:05}.tlog" for number in range(300)]
    for number, log in enumerate(logs):
        log.parent.mkdir(exist_ok=True)
        log.write_bytes(moved(made[number % 3], DAY_S * number))
    print(f"{len(logs)} logs of {logs[0].stat().st_size / 1e6:.1f} MB")
    analyse(logs[0])
    with timed("plain loop", len(logs), "logs"):
        for log in logs:
            analyse(log)
    for workers in (1, 2):
        options = fleet.ScanOptions(judging=Options(aircraft="folder"), workers=workers)
        times: list[float] = []
        with timed(f"scan, {workers} workers, with start and comparison", len(logs), "logs"):
            fleet.scan(
                [folder],
                folder / f"store-{workers}",
                options,
                progress=lambda done, total, times=times: times.append(time.perf_counter()),  # type: ignore[misc]
            )
        first, last = times[len(times) // 4], times[-1]
        print(f"  in full swing {len(times) * 0.75 / (last - first):.1f} logs/s")
    with timed("the same again, nothing new"):
        fleet.scan([folder], folder / "store-2", options)


def many(folder: Path) -> None:
    made = kinds(folder, 120.0)
    logs = [folder / f"{number:05}.tlog" for number in range(120)]
    for number, log in enumerate(logs):
        log.write_bytes(moved(made[number % 3], DAY_S * number))
    analyse(logs[0])
    for jobs in (1, 2):
        with timed(f"analyse --jobs {jobs}", len(logs), "logs"):
            for _ in analyse_many(logs, batch=Batch(jobs=jobs)):
                pass


def memory(folder: Path) -> None:
    made = kinds(folder, 40.0)
    for count in (100, 2_000):
        logs = folder / str(count)
        for number in range(count):
            log = logs / f"D-{number % 20}" / f"{number:05}.tlog"
            log.parent.mkdir(parents=True, exist_ok=True)
            log.write_bytes(moved(made[number % 3], DAY_S * number))
        with watched() as used:
            fleet.scan(
                [logs], folder / f"store-{count}", fleet.ScanOptions(judging=Options(aircraft="folder"))
            )
        print(
            f"scan of {count} logs: driver {used.driver_mb:.0f} MB, worker {used.worker_mb:.0f} MB",
            flush=True,
        )


def copies_of(
    alone: StandaloneAssessment, folder: Path, aircraft: int, flights: int
) -> Iterator[StandaloneAssessment]:
    """Yield a flight as if it had been flown on many days."""
    log = alone.assessment.log
    start = datetime.fromisoformat(log.start_utc or "")
    for day in range(flights):
        changed = {
            "path": str(folder / f"D-{aircraft:03}" / f"{day:05}.tlog"),
            "sha256": f"{aircraft:032x}{day:032x}",
            "start_utc": (start + timedelta(days=day)).isoformat(),
            "flight": (),
        }
        moved_on = alone.assessment.model_copy(update={"log": log.model_copy(update=changed)})
        yield alone._replace(assessment=moved_on)


def growth(folder: Path) -> None:
    made = kinds(folder, 40.0)
    (folder / "one.tlog").write_bytes(made[0])
    alone = analyse_alone(folder / "one.tlog", Options().resolved())
    store = folder / "store"
    for aircraft in range(AIRCRAFT):
        flights = copies_of(alone, folder, aircraft, 10_000 // AIRCRAFT)
        rows = [row_of(flight.assessment, f"D-{aircraft:03}", flight) for flight in flights]
        add(store, *rows, compares=False)
    print(f"store of 10,000 flights of 40 s: {store.stat().st_size / 1e6:.0f} MB")
    for aircraft in range(10):
        log = folder / "new" / f"D-{aircraft:03}" / "new.tlog"
        log.parent.mkdir(parents=True)
        log.write_bytes(moved(made[1], 400 * DAY_S))
    with timed("scan of 10 new logs of 10 aircraft into a store of 10,000"):
        print(
            fleet.scan(
                [folder / "new"], folder / "store", fleet.ScanOptions(judging=Options(aircraft="folder"))
            )
        )


def questions(folder: Path) -> None:
    (folder / "one.tlog").write_bytes(kinds(folder, 120.0)[0])
    alone = analyse_alone(folder / "one.tlog", Options().resolved())
    each, store = len(alone.assessment.verdicts), folder / "store"
    flights = VERDICTS // AIRCRAFT // each
    rows = [
        row_of(flight.assessment, f"D-{aircraft:03}", flight)
        for aircraft in range(AIRCRAFT)
        for flight in copies_of(alone, folder, aircraft, 1)
    ]
    add(store, *rows, compares=False)
    changed = {
        "id": f"id + {AIRCRAFT} * day",
        "flight_id": f"flight_id + {AIRCRAFT} * day",
        "sha256": "sha256 || '-' || day",
        "start_us": "start_us - 86400000000 * day",
        "came_us": "came_us - 86400000000 * day",
        "last": "false",
        "reference": f"day >= {flights - 20}",
        "boot_us": "boot_us - 86400000000 * day",
        "path": "path || day",
    }
    days = (
        f"WITH RECURSIVE days(day) AS (SELECT 1 UNION ALL SELECT day + 1 FROM days WHERE day < {flights - 1})"
    )
    with Store(store).writing() as connection:
        for name in ("flight", "log", "recording", "verdict", "indicator", "record"):
            columns = [column.name for column in METADATA.tables[name].columns]
            values = ", ".join(changed.get(column, f'"{column}"') for column in columns)
            names = ", ".join(f'"{column}"' for column in columns)
            copied = f"INSERT INTO {name} ({names}) {days} SELECT {values} FROM {name}, days"
            connection.exec_driver_sql(copied)
    print(f"{store.stat().st_size / 1e9:.1f} GB", flush=True)
    for _ in range(3):
        with timed(f"worst 20 of {each * flights * AIRCRAFT} verdicts"):
            fleet.worst(store, most=20)
        with timed("status"):
            fleet.status(store)
        with timed("the page's list of aircraft"):
            aircraft_table(fleet.worst(store))
        with timed("digest of a day"):
            fleet.digest(store, datetime.now(UTC) - timedelta(days=1))
        with timed("exit code of all"):
            exit_code(store)
        with timed(f"trend of one aircraft, {flights} flights"):
            fleet.trend(store, "D-007")
        with timed("its flights"):
            last = all_flights(store, "D-007")[-1].log
        with timed("one of them"):
            flight(store, "D-007", last.sha256 or "")


def landed(what: str, store: Path, log: bytes, day: float, airframe: Airframe | None = None) -> None:
    """Keep one more flight of the aircraft of a store."""
    path = store.parent / "logs" / "D-000" / f"{day:g}.tlog"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(moved(log, DAY_S * day))
    with timed(what):
        analyse(path, airframe=airframe, store=store, aircraft="folder", keep=True)


def stored(folder: Path, *, airframe: Airframe | None = None, compares: bool = True) -> None:
    made = kinds(folder, 40.0)
    (folder / "one.tlog").write_bytes(made[0])
    alone = analyse_alone(folder / "one.tlog", Options(airframe=airframe).resolved())
    for count in LANDINGS:
        store = folder / str(count) / "store"
        rows = (row_of(flight.assessment, "D-000", flight) for flight in copies_of(alone, folder, 0, count))
        with timed(f"{count} flights of one aircraft put into a store", count, "flights"):
            add(store, *rows, compares=compares)
        for again in range(3):
            landed(f"landing after {count} flights", store, made[1], 20_000 + again, airframe)
    if compares:
        landed(f"late log among {count} flights", store, made[1], 0.5, airframe)


def unlimited(folder: Path) -> None:
    """The same without a data sheet: a comparison takes the records of earlier flights."""
    paper = load_airframe("paper")
    nothing = {"ema": None, "limits": None, "travel_deg": None}
    own = tuple(actuator.model_copy(update=nothing) for actuator in paper.actuators)
    stored(folder, airframe=paper.model_copy(update={"actuators": own}), compares=False)


PARTS: dict[str, Callable[[Path], None]] = {
    part.__name__: part for part in (stored, unlimited, questions, growth, many, scans, memory)
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "parts", nargs="*", metavar="PART", choices=[[], *PARTS], help="all parts if none is named"
    )
    parts = parser.parse_args().parts or list(PARTS)
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for part in parts:
        with tempfile.TemporaryDirectory() as folder:
            print(f"# {part}")
            PARTS[part](Path(folder))


if __name__ == "__main__":
    main()
