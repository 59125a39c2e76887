"""Stores of flights that nobody flew."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime
from pathlib import Path
from unittest.mock import patch

from sqlalchemy import select

from mavhums import Options, fleet
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.compare import packed
from mavhums.flights.history import PastFlight
from mavhums.flights.store import Row, Store
from mavhums.flights.store.logs import add_logs
from mavhums.flights.store.tables import METADATA, us_of
from mavhums.flights.store.verdicts import make_verdicts
from mavhums.results.assessment import Assessment
from tests.fleet_logs import moved

FOLDER = fleet.ScanOptions(judging=Options(aircraft="folder"), workers=0)
"""A scan in this process by the rule that the folder of a log names its aircraft."""


def write_logs(folder: Path, *logs: bytes, first: int = 0) -> Path:
    """Write logs into a folder, received a day after each other."""
    folder.mkdir(parents=True, exist_ok=True)
    for day, data in enumerate(logs, first):
        (folder / f"{day:02}.tlog").write_bytes(moved(data, 86_400.0 * day))
    return folder


def row_of(assessment: Assessment, aircraft: str, flight: StandaloneAssessment | None = None) -> Row:
    """Return a log's row, as a worker gives it; without the flight's records if it is not given."""
    log = assessment.log
    return Row(
        path=log.path or "",
        size=1,
        time_ns=1,
        settings="",
        sha256=log.sha256,
        aircraft=aircraft,
        start_us=us_of(PastFlight.of(assessment).start) if log.start_utc else None,
        duration_s=log.duration_s,
        flight=packed(flight or StandaloneAssessment(assessment, {})),
    )


def add(store: str | Path, *rows: Row, compares: bool = True, at: datetime | None = None) -> None:
    """Put rows into a store at a time; their verdicts stay as they are unless they are compared."""
    with ExitStack() as patches, Store(store).writing() as connection:
        if at is not None:
            patches.enter_context(patch("mavhums.flights.store.verdicts.now_us", lambda: us_of(at)))
        if not compares:
            alone = patch("mavhums.flights.store.verdicts.compared", lambda flight, *_: flight.assessment)
            patches.enter_context(alone)
        add_logs(connection, rows)
        make_verdicts(connection)


def write_store(store: Path, flown: dict[str, list[Assessment]], at: datetime | None = None) -> None:
    """Write the flights of each aircraft, judged already, at a time."""
    rows = [row_of(flight, aircraft) for aircraft, flights in flown.items() for flight in flights]
    add(store, *rows, compares=False, at=at)


def verdicts_of(store: Path, *aircraft: str) -> dict[str, list[str]]:
    """Return the verdicts of each log as JSON, in the order of the texts."""
    judged: dict[str, list[str]] = {}
    for name in aircraft:
        for log, verdict in fleet.verdicts(store, name):
            judged.setdefault(log, []).append(verdict.model_dump_json())
    return {log: sorted(several) for log, several in judged.items()}


def table(store: str | Path, name: str) -> list[dict[str, object]]:
    """Return the rows of a table of a store."""
    with Store(store).reading() as connection:
        return [dict(row) for row in connection.execute(select(METADATA.tables[name])).mappings()]


@contextmanager
def postgres() -> Iterator[str]:
    """Run a server of its own, which listens at a socket in its folder alone; yield its address.

    Raises
    ------
    FileNotFoundError
        If PostgreSQL is not installed.
    """
    binaries = Path(shutil.which("postgres") or "none").resolve().parent
    if not (binaries / "initdb").exists():
        raise FileNotFoundError("PostgreSQL is not installed")
    user = "nobody" if hasattr(os, "geteuid") and os.geteuid() == 0 else None  # it refuses to run as root
    with tempfile.TemporaryDirectory(prefix="pg-", dir="/tmp") as folder:
        if user:
            shutil.chown(folder, user)
        data, sockets = f"{folder}/data", f"-c listen_addresses= -k {folder} -c fsync=off"
        make = [binaries / "initdb", "-D", data, "-U", "fleet", "-A", "trust", "-E", "UTF8", "--no-sync"]
        control = [binaries / "pg_ctl", "-D", data, "-w"]
        start = [*control, "-l", f"{folder}/log", "-o", sockets, "start"]
        stop = [*control, "-m", "immediate", "stop"]
        for command in (make, start):
            subprocess.run([*map(str, command)], check=True, stdout=subprocess.DEVNULL, user=user, cwd=folder)
        try:
            yield f"postgresql://fleet@/postgres?host={folder}"
        finally:
            subprocess.run([*map(str, stop)], check=True, stdout=subprocess.DEVNULL, user=user, cwd=folder)
