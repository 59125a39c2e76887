"""Which folders are collected; examples in docstrings run in a folder with a ``flight.tlog``."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path

import pytest
from _pytest.doctest import DoctestItem

from mavhums_sim import Flight, fly, write_tlog

# The store of whoever runs the tests is never theirs.
os.environ["MAVHUMS_STORE"] = "none"

# Without PyTorch there is nothing to train: `make test` then leaves out the rooms that do.
WITHOUT_TORCH = ("learn", "study", "training")
collect_ignore = (
    [] if find_spec("torch") else [f"{top}/{room}" for top in ("mavhums", "tests") for room in WITHOUT_TORCH]
)


def pytest_report_header() -> list[str]:
    """Say which tests are left out."""
    return [f"PyTorch is absent: tests of {', '.join(WITHOUT_TORCH)} are left out"] if collect_ignore else []


@pytest.fixture(scope="session")
def example_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty seconds in which the elevator is an emergency, as ``flight.tlog``."""
    folder = tmp_path_factory.mktemp("examples")
    flight = Flight(seed=5, duration_s=20.0, rate_hz=50.0, friction_nm={"elevator": (1.0, 1.0)})
    write_tlog(fly(flight), folder / "flight.tlog")
    return folder


@pytest.fixture(autouse=True)
def _in_example_folder(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if isinstance(request.node, DoctestItem):
        monkeypatch.chdir(request.getfixturevalue("example_folder"))
