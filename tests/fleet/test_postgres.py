"""A store in PostgreSQL says what a file says; two that write at once wait for each other."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from mavhums import fleet
from tests.fleet.stores import add, row_of
from tests.fleet.test_corrections import FOREIGN, GROWS, STILL, held
from tests.flights import START, flown, verdict

pytest.importorskip("psycopg")
USER = "nobody" if hasattr(os, "geteuid") and os.geteuid() == 0 else None


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    """The address of a server of its own, which listens at a socket in its folder alone."""
    found = shutil.which("postgres")
    binaries = Path(found).resolve().parent if found else None
    if binaries is None or not (binaries / "initdb").exists():
        pytest.skip("PostgreSQL is not installed")
    with tempfile.TemporaryDirectory(prefix="pg-", dir="/tmp") as folder:
        if USER:
            shutil.chown(folder, USER)
        data, sockets = f"{folder}/data", f"-c listen_addresses= -k {folder} -c fsync=off"
        make = [binaries / "initdb", "-D", data, "-U", "fleet", "-A", "trust", "-E", "UTF8", "--no-sync"]
        start = [binaries / "pg_ctl", "-D", data, "-w", "-l", f"{folder}/log", "-o", sockets, "start"]
        stop = [binaries / "pg_ctl", "-D", data, "-m", "immediate", "stop"]
        for command in (make, start):
            subprocess.run([*map(str, command)], check=True, stdout=subprocess.DEVNULL, user=USER, cwd=folder)
        yield f"postgresql://fleet@/postgres?host={folder}"
        subprocess.run([*map(str, stop)], check=True, stdout=subprocess.DEVNULL, user=USER, cwd=folder)


@pytest.mark.slow
def test_a_database_says_what_a_file_says(server: str, tmp_path: Path) -> None:
    rows = [*GROWS, *STILL, *FOREIGN]
    rows += [
        row_of(flown(verdict(), name="unknown"), ""),
        rows[0]._replace(path="bad", flight=None, problem="p", remedy="r"),
    ]
    random.Random(1).shuffle(rows)
    said = []
    for place in (server, str(tmp_path / "store")):
        store = Path(place) if "://" not in place else place
        with ThreadPoolExecutor(3) as several:  # each its own transaction, one after the other
            assert [*several.map(lambda row, store=store: add(store, row), rows)] == [None] * len(rows)
        fleet.remove(store, ["logs/D-C/03.tlog"])
        fleet.move(store, ["logs/D-C/04.tlog"], "D-B")
        fleet.rename(store, "D-B", "D-Z")
        fleet.undo(store, 1)
        fleet.change_repairs(store, add=[fleet.Repair("D-A", None, START)])
        frame = fleet.export(store)
        said.append(
            (
                held(store),
                [(one.aircraft, one.verdict) for one in fleet.worst(store)],
                fleet.trend(store, "D-A").to_json(),
                fleet.digest(store, START).changes,
                frame.astype(str).to_numpy().tolist(),
            )
        )
    for one, other in zip(*said, strict=True):
        assert one == other
