"""A store in PostgreSQL says what a file says; two that write at once wait for each other."""

from __future__ import annotations

import random
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest

from mavhums import fleet
from tests.fleet.stores import add, postgres, row_of
from tests.fleet.test_corrections import FOREIGN, GROWS, STILL, held
from tests.flights import START, flown, verdict

pytest.importorskip("psycopg")


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    with ExitStack() as stack:
        try:
            address = stack.enter_context(postgres())
        except FileNotFoundError:
            pytest.skip("PostgreSQL is not installed")
        yield address


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
