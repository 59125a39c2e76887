"""Fixtures that several rooms share: the command line, simulated flights, real logs where they are named."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, TypeVar

import pytest
from hypothesis import settings

from mavhums.cli import main as cli
from mavhums_sim import Flight, FlightRecord, fly, write_tlog

# Every run draws the same examples, so a failure is of the change and not of the draw; how fast a machine is
# shows nothing of the code. "--hypothesis-profile explore" draws new examples.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None)
settings.load_profile("repeatable")

if (
    signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    and threading.current_thread() is threading.main_thread()
):
    # A shell starts background jobs with ignored interrupts, and their children inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Real logs are used only where MAVHUMS_REAL_LOGS names their folder: a clone has nothing beside it.
REAL_LOGS = Path(os.environ.get("MAVHUMS_REAL_LOGS") or os.devnull)
CARRIED = Path(__file__).parent / "data"  # simulated flights that travel with the tests
SINGLE = (".", "sitl", "onboard")  # folders of logs that each differ
CAMPAIGNS = ("alfa", "sitl/control")  # folders of many flights of one kind


def carried_logs() -> list[Path]:
    """Simulated flights that travel with the tests; ``tests/data/README.md`` has their commands."""
    return sorted(path for path in CARRIED.iterdir() if path.suffix in (".tlog", ".BIN"))


def real_logs(*folders: str) -> list[Path]:
    """Logs in these folders of the real logs; by default of each, and of a campaign each sixteenth."""
    return sorted(
        path
        for folder in folders or (*SINGLE, *CAMPAIGNS)
        for path in sorted(
            path
            for path in (REAL_LOGS / folder).glob("*")
            if path.is_file() and path.suffix not in (".md", ".csv")
        )[:: 16 if folder in CAMPAIGNS else 1]
    )


Test = TypeVar("Test", bound=Callable[..., object])


def needs(path: Path) -> Callable[[Test], Test]:
    """Mark a test of real logs: skipped where ``path`` is absent, and read only with ``make test-all``."""

    def mark(test: Test) -> Test:
        absent = pytest.mark.skipif(
            not (path.is_dir() or path.is_file()), reason=f"{path.name} is not beside MAVHUMS_REAL_LOGS"
        )
        marked: Test = pytest.mark.slow(absent(test))
        return marked

    return mark


LONGEST = {  # a minute or more each: begun last, they would run alone
    "test_training_mixes_and_weighs_them",
    "test_a_model_for_less_is_trained_calibrated_and_repeatable",
    "test_the_browser_shows_the_same",
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip real logs that are absent; read those that are there only with ``make test-all``."""
    for item in items:
        parameters = item.callspec.params.values() if hasattr(item, "callspec") else ()
        for path in parameters:
            if not isinstance(path, Path) or not path.is_relative_to(REAL_LOGS):
                continue
            item.add_marker(pytest.mark.slow)
            if not path.is_file():
                item.add_marker(pytest.mark.skip(f"{path.name} is not in MAVHUMS_REAL_LOGS"))
    items.sort(key=lambda item: item.name.partition("[")[0] not in LONGEST)


class Outcome(NamedTuple):
    code: int
    out: str
    err: str


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """Let no file grow beyond a size, as on a full disk."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


Run = Callable[..., Outcome]
_COMPILING = "compiling its inner loops"  # the first command after an installation says so


@pytest.fixture(autouse=True)
def interruptible() -> Iterator[None]:
    """Undo what a command does to Ctrl-C when it ends: here the program goes on."""
    before = signal.getsignal(signal.SIGINT)
    yield
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, before)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: str | Path) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["mavhums", *map(str, arguments)])
        capfd.readouterr()
        try:
            cli.main()
            code = 0
        except SystemExit as stop:
            code = int(stop.code or 0)
        out, printed = capfd.readouterr()
        err = "".join(line for line in printed.splitlines(keepends=True) if _COMPILING not in line)
        return Outcome(code, out, err)

    return call


@pytest.fixture(scope="session")
def growing_record() -> FlightRecord:
    """Forty seconds in which the elevator's friction grows through both limits."""
    return fly(Flight(seed=11, duration_s=40.0, friction_nm={"elevator": (0.2, 1.2)}))


@pytest.fixture(scope="session")
def growing_log(growing_record: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("growing") / "growing.tlog"
    write_tlog(growing_record, path)
    return path


@pytest.fixture(scope="session")
def healthy_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Forty healthy seconds."""
    path = tmp_path_factory.mktemp("healthy") / "healthy.tlog"
    write_tlog(fly(Flight(seed=21, duration_s=40.0)), path)
    return path


@pytest.fixture(scope="session")
def short_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fifteen healthy seconds at 20 Hz: small enough to be cut a hundred ways."""
    path = tmp_path_factory.mktemp("short") / "short.tlog"
    write_tlog(fly(Flight(seed=12, duration_s=15.0, rate_hz=20.0)), path)
    return path
