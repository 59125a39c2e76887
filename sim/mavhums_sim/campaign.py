"""Campaigns of many flights on all cores, to logs with ground truth or directly to a consumer."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from mavhums_sim._files import written_whole
from mavhums_sim.flight import Flight, FlightRecord, fly
from mavhums_sim.link import LAST_DAY, Link
from mavhums_sim.telemetry import write_tlog

PAPER_FRICTION_NM = (0.225, 0.275, 0.325, 0.375, 0.875, 0.925, 0.975, 1.025)
_SURFACE = "elevator"
_JOURNAL = "truth.jsonl"

T = TypeVar("T")
Name = TypeVar("Name")
Truth = dict[str, Any]


def paper_campaign(seed: int = 0, duration_s: float = 100.0) -> Iterator[tuple[str, Flight]]:
    """Yield (name, flight): the elevator at each of the paper's frictions, and growing from 0.225 to 1.0 N·m.

    Every flight has its own seed, and therefore its own pilot and gusts.
    """
    for k, friction in enumerate(PAPER_FRICTION_NM):
        flight = Flight(
            seed=100 * seed + k, duration_s=duration_s, friction_nm={_SURFACE: (friction, friction)}
        )
        yield f"friction-{friction:.3f}", flight
    growing = Flight(
        seed=100 * seed + len(PAPER_FRICTION_NM), duration_s=duration_s, friction_nm={_SURFACE: (0.225, 1.0)}
    )
    yield "friction-growing", growing


CAMPAIGNS: dict[str, Callable[[int, float], Iterator[tuple[str, Flight]]]] = {"paper": paper_campaign}


def consume(
    flights: Iterable[tuple[Name, Flight]], consumer: Callable[[Name, FlightRecord], T], workers: int = 1
) -> Iterator[tuple[Name, T]]:
    """Simulate each flight, pass its record to a consumer, and yield (name, the consumer's result).

    The consumer runs in the process that simulates the flight, so large arrays are not copied between
    processes: the consumer returns only what must be kept.

    Parameters
    ----------
    flights
        (name, flight) pairs.
    consumer
        Called with the name and the record; with several workers it must be a function of a module.
    workers
        Number of processes; 1 uses this process. Results are in the order of the flights.

    Examples
    --------
    >>> flights = [(str(seed), Flight(seed=seed, duration_s=2.0)) for seed in range(3)]
    >>> [name for name, _ in consume(flights, lambda name, record: record.actuators["rudder"].values)]
    ['0', '1', '2']
    """
    if workers == 1:
        for name, flight in flights:
            yield name, _fly_and_consume(name, flight, consumer)
        return
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(
        workers, context, initializer=signal.signal, initargs=(signal.SIGINT, signal.SIG_IGN)
    )
    try:
        waiting = iter(flights)
        running: list[tuple[Name, Future[T]]] = []
        while True:
            for name, flight in islice(waiting, 4 * workers - len(running)):
                running.append((name, pool.submit(_fly_and_consume, name, flight, consumer)))
            if not running:
                return
            name, future = running.pop(0)
            yield name, future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _fly_and_consume(name: Name, flight: Flight, consumer: Callable[[Name, FlightRecord], T]) -> T:
    return consumer(name, fly(flight))


def run_campaign(
    flights: list[tuple[str, Flight]],
    folder: Path,
    progress: Callable[[int, int], None] | None = None,
    *,
    link: Link | None = None,
    workers: int = 1,
) -> Path:
    """Simulate and log each flight into ``folder``, and return the path of its ``truth.json``.

    Flights that an interrupted run of the same campaign completed are not simulated again.

    Parameters
    ----------
    flights
        (name, flight) pairs; each becomes ``NAME.tlog``.
    folder
        Created if it does not exist.
    progress
        Called after each flight with the number completed and the total.
    link
        Link between each aircraft and its log; each flight begins a day after the one before it.
    workers
        Number of processes.

    Raises
    ------
    OSError
        If the folder or a file in it cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    link = link or Link()
    prints = {name: _fingerprint(flight, link) for name, flight in flights}
    truths = {
        name: truth
        for name, truth in _finished(folder).items()
        if truth.get("fingerprint") == prints.get(name) and (folder / f"{name}.tlog").exists()
    }
    left = [
        ((name, float(number % LAST_DAY)), flight)
        for number, (name, flight) in enumerate(flights)
        if name not in truths
    ]
    with (folder / _JOURNAL).open("a", encoding="utf-8") as journal:
        for (name, _), truth in consume(left, partial(_log, folder=folder, link=link), workers):
            truths[name] = {**truth, "fingerprint": prints[name]}
            journal.write(json.dumps(truths[name]) + "\n")
            journal.flush()
            if progress:
                progress(len(truths), len(flights))
    path = write_truth([truths[name] for name, _ in flights], folder / "truth.json")
    (folder / _JOURNAL).unlink()
    return path


def _log(named: tuple[str, float], record: FlightRecord, *, folder: Path, link: Link) -> Truth:
    name, days = named
    log = folder / f"{name}.tlog"
    counts = write_tlog(record, log, replace(link, day=(link.day + days) % LAST_DAY))
    return {"log": log.name, **record.truth(), "messages": counts}


def _fingerprint(flight: Flight, link: Link) -> str:
    """Identify a flight by its description."""
    described = repr((flight, link))
    if not isinstance(flight.cyclogram, str):
        commands = b"".join(command.tobytes() for command in flight.cyclogram.commands.values())
        described += hashlib.sha256(commands).hexdigest()
    return hashlib.sha256(described.encode()).hexdigest()[:16]


def _finished(folder: Path) -> dict[str, Truth]:
    """Return the ground truth from earlier runs, by flight."""
    truths: list[Truth] = []
    with suppress(FileNotFoundError, ValueError, KeyError):
        truths += json.loads((folder / "truth.json").read_text(encoding="utf-8"))["flights"]
    with suppress(FileNotFoundError, ValueError):  # the last line of a killed run may be incomplete
        for line in (folder / _JOURNAL).read_text(encoding="utf-8").splitlines():
            truths.append(json.loads(line))
    return {str(truth.get("log", "")).removesuffix(".tlog"): truth for truth in truths}


def write_truth(flights: list[dict[str, object]], path: Path) -> Path:
    """Write ground truth as JSON, atomically, and return its path."""
    with written_whole(path) as temporary:
        temporary.write_text(json.dumps({"flights": flights}, indent=2) + "\n", encoding="utf-8")
    return path
