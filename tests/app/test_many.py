"""Many logs at once: the same outcomes as one after the other, whatever happens to one of them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import psutil
import pytest

import mavhums
from mavhums import fleet
from mavhums.app.analysis import Batch, analyse_many
from mavhums.app.settings import Options
from mavhums.core.errors import ExitCode
from mavhums.core.process_pool import LostItem, in_processes
from tests.conftest import Run
from tests.fleet_logs import moved, small

DAY_S = 86_400.0


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Twelve flights of an aircraft, the last worn; the fourth is noise."""
    folder = tmp_path_factory.mktemp("logs")
    kinds = small(0), small(1), small(8, 0.3)
    paths = [folder / f"{day:02}.tlog" for day in range(12)]
    for day, path in enumerate(paths):
        path.write_bytes(moved(kinds[2 if day == 11 else day % 2], DAY_S * day))
    paths[3].write_bytes(b"no log")
    return paths


def outcomes(logs: Sequence[Path], store: Path, jobs: int) -> list[tuple[str, str | None, str | None]]:
    options = Options(store=store, keep=True, aircraft="=D-A", false_alarms=2.0)
    return [
        (
            one.log.name,
            one.assessment.to_json() if one.assessment else None,
            one.error.problem if one.error else None,
        )
        for one in analyse_many(logs, options, Batch(jobs=jobs))
    ]


@pytest.mark.slow
def test_several_processes_say_the_same_in_the_same_order(logs: list[Path], tmp_path: Path) -> None:
    alone = outcomes(logs, tmp_path / "one", 1)
    together = outcomes(logs, tmp_path / "two", 2)
    assert together == alone
    assert [name for name, _, _ in alone] == [log.name for log in logs]
    assert [problem is None for _, _, problem in alone] == [day != 3 for day in range(12)]
    assert "drift" in (alone[-1][1] or "")
    assert fleet.verdicts(tmp_path / "one", "D-A") == fleet.verdicts(tmp_path / "two", "D-A")
    assert fleet.status(tmp_path / "one").judged == 11


@pytest.mark.slow
def test_an_error_hides_no_emergency_and_json_has_both(run: Run, logs: list[Path], growing_log: Path) -> None:
    outcomes = [run("analyse", logs[3], growing_log, logs[0], "--json", "--jobs", jobs) for jobs in "12"]
    assert outcomes[0] == outcomes[1]
    assert outcomes[0].code == ExitCode.EMERGENCY
    assert "03.tlog" in outcomes[0].err
    content = json.loads(outcomes[0].out)
    assert [one["log"]["path"] for one in content["assessments"]] == [str(growing_log), str(logs[0])]
    assert [one["log"] for one in content["failures"]] == [str(logs[3])]
    assert content["failures"][0]["remedy"]
    assert outcomes[0].out == json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def test_what_nobody_expected_is_its_logs_outcome(logs: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(path: Path, *_: object, **__: object) -> None:
        raise ZeroDivisionError("nought")

    monkeypatch.setattr("mavhums.app.analysis.analyse_alone", fails)
    errors = [one.error for one in analyse_many(logs[:2], batch=Batch(jobs=1))]
    assert [error.problem for error in errors if error] == [
        f"{log}: ZeroDivisionError: nought" for log in logs[:2]
    ]
    with pytest.raises(ZeroDivisionError):
        list(analyse_many(logs[:1]))


def test_options_that_cannot_be_used_are_refused_at_once(logs: list[Path]) -> None:
    with pytest.raises(mavhums.ProfileError):
        next(analyse_many(logs, Options(airframe="nonesuch"), Batch(jobs=2)))


class Deadly:
    """Doubles a number; on some, the process dies: so often as there are files to take away."""

    def __init__(self, numbers: Sequence[int], lives: Path) -> None:
        self.numbers, self.lives = numbers, lives

    def __call__(self, number: int) -> int:
        left = sorted(self.lives.iterdir())
        if number in self.numbers and left:
            left[0].unlink()
            os.kill(os.getpid(), signal.SIGKILL)
        return 2 * number


@pytest.mark.slow
@pytest.mark.parametrize(("deaths", "lost"), [(1, []), (2, [5])])
def test_a_process_that_dies_loses_only_the_item_that_kills_it_again(
    tmp_path: Path, deaths: int, lost: list[int]
) -> None:
    for number in range(deaths):
        (tmp_path / str(number)).touch()
    results = list(in_processes(Deadly([5], tmp_path), range(12), 2))
    assert results == [LostItem() if number in lost else 2 * number for number in range(12)]


def test_iteration_that_ends_early_ends_the_processes(tmp_path: Path) -> None:
    before = set(psutil.Process().children(recursive=True))
    with closing(in_processes(Deadly([], tmp_path), range(100), 2)) as results:
        assert next(results) == 0
    assert not [child for child in {*psutil.Process().children(recursive=True)} - before if judges(child)]


def judges(process: psutil.Process) -> bool:
    """Whether a process still judges logs: one that has ended but was not waited for does not."""
    try:
        return "spawn_main" in " ".join(process.cmdline())
    except psutil.NoSuchProcess:
        return False


@pytest.fixture
def busy(logs: list[Path]) -> subprocess.Popen[str]:
    """A command that has judged its first log of a thousand."""
    command = [sys.executable, "-m", "mavhums", "analyse", *logs[:1] * 1000]
    process = subprocess.Popen(
        [*map(str, command), "--jobs", "2", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    while '"remedy"' not in process.stdout.readline():
        pass
    return process


def test_ctrl_c_ends_processes_and_leaves_whole_json(logs: list[Path], busy: subprocess.Popen[str]) -> None:
    os.killpg(busy.pid, signal.SIGINT)
    rest, errors = busy.communicate(timeout=60)
    assert busy.returncode == 130
    assert "Traceback" not in errors
    assert rest.endswith('],\n  "failures": []\n}\n')


INTERRUPTED_START = """
import os, signal, sys, threading, time
from multiprocessing import forkserver
from multiprocessing.process import BaseProcess
from mavhums.core.process_pool import in_processes

def connect(files, start=forkserver.connect_to_new_process):
    ends = start(files)
    os.kill(os.getpid(), signal.SIGINT)
    return ends

if __name__ != "__main__":
    time.sleep(0.3)  # a process on a busy machine starts late, and is ended late
if __name__ == "__main__":
    threading.Thread(target=threading.Event().wait, daemon=True).start()  # takes signals that main blocks
    forkserver.connect_to_new_process = connect
    end = BaseProcess.terminate
    BaseProcess.terminate = lambda process: (time.sleep(1), end(process))
    try:
        list(in_processes(abs, range(9), 2))
    except KeyboardInterrupt:
        sys.exit(130)
"""


INTERRUPTED_WAIT = """
import os, signal, sys, threading, time
from multiprocessing import resource_tracker
from mavhums.core.process_pool import in_processes

def interrupt(caller):
    os.kill(caller, signal.SIGINT)
    time.sleep(600)

if __name__ == "__main__":
    threading.Thread(target=threading.Event().wait, daemon=True).start()
    resource_tracker.ensure_running()  # its start would unblock Ctrl-C
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # the thread takes it: the wait goes on
    try:
        list(in_processes(interrupt, [os.getpid()], 1))
    except KeyboardInterrupt:
        sys.exit(130)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "program", [INTERRUPTED_START, INTERRUPTED_WAIT], ids=["while a process starts", "and no wait wakes"]
)
def test_ctrl_c_ends_the_program_silently(program: str, tmp_path: Path) -> None:
    script = tmp_path / "interrupted.py"
    script.write_text(program)
    done = subprocess.run([sys.executable, script], check=False, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (130, "")


@pytest.mark.slow
def test_the_processes_end_with_a_command_that_is_killed(busy: subprocess.Popen[str]) -> None:
    children = psutil.Process(busy.pid).children(recursive=True)
    assert children
    busy.kill()
    busy.communicate(timeout=60)
    _, alive = psutil.wait_procs(children, timeout=60)
    assert not alive


@pytest.mark.slow
def test_analyse_loads_nothing_heavy_that_it_does_not_need(logs: list[Path]) -> None:
    heavy = {"torch", "sklearn", "pandas", "pyarrow", "distributed", "sqlalchemy", "rerun", "scipy.stats"}
    code = (
        "import sys\nfrom mavhums.cli.main import main\n"
        f"sys.argv[1:] = ['analyse', {str(logs[0])!r}]\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"print('loaded:', sorted({heavy!r} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("loaded: []\n")
