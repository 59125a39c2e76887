"""The examples run, and show what they say."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from click.testing import CliRunner

from examples import (
    analyse_a_log,
    demo,
    follow_udp,
    own_recording,
    pictures,
    quantities_to_pandas,
    sample_classes,
    selectors_in_a_pipeline,
    wear_over_flights,
)
from mavhums import analyse
from mavhums.cli.main import cli
from mavhums_sim.campaign import paper_campaign, run_campaign
from tests.links import records


@pytest.mark.slow
def test_the_class_of_each_sample_is_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Figures 16 to 19 of the paper, of simulated flights, for each packaged network."""
    pytest.importorskip("matplotlib")
    worn = {"emergency, 1.025 N·m": 1.025}
    monkeypatch.setattr(sample_classes, "FRICTION_NM", worn)
    sample_classes.main(tmp_path / "classes.png")
    assert (tmp_path / "classes.png").read_bytes().startswith(b"\x89PNG")
    printed = capsys.readouterr().out
    shares = re.findall(r"emergency, 1.025 N·m; ([\w-]+): ([\d.]+) % of the samples in motion", printed)
    assert [model for model, _ in shares] == [*sample_classes.MODELS]
    assert all(float(share) > 80 for _, share in shares)


@pytest.mark.slow
def test_selectors_compose_with_the_models_of_scikit_learn() -> None:
    """Algorithm 1 keeps what separates the conditions, and networks beat a fixed polynomial."""
    pytest.importorskip("torch")
    results = selectors_in_a_pipeline.main(seconds=4.0)
    assert len(results) == 6
    assert results["Algorithm 1 → tanh networks"] > 0.9
    assert results["Algorithm 1 → tanh networks"] > results["chi-square, best 6 → tanh networks"]


@pytest.mark.parametrize("guide", ["ardupilot", "px4"])
def test_a_guides_flight_is_judged_as_it_prints_it(guide: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to the dots; lines end where the printed ones do."""
    root = Path(__file__).parents[1]
    text = (root / "docs" / "guide" / f"{guide}.md").read_text(encoding="utf-8")
    [(log, answer)] = re.findall(r"\$ mavhums analyse (\S+)\n(.*?)…\n", text, re.DOTALL)
    monkeypatch.setenv("COLUMNS", "80")
    printed = CliRunner().invoke(cli, ["analyse", str(root / log)]).stdout
    lines = [line.rstrip() for line in printed.splitlines()]
    assert lines[: answer.count("\n")] == [line.rstrip() for line in answer.splitlines()]


def test_the_demos_last_flight_is_judged_as_the_readme_prints_it(tmp_path: Path) -> None:
    flight = [(name, flown) for name, flown in paper_campaign() if name == demo.SHOWN]
    run_campaign(flight, tmp_path, workers=1)
    printed = CliRunner().invoke(cli, ["analyse", str(tmp_path / f"{demo.SHOWN}.tlog")]).stdout
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    block = re.search(r"^\$ \S*mavhums analyse demo/.*\n((?:.*\n)*?)```", readme, re.MULTILINE)
    assert block, "the README prints no answer"
    said = [line for line in block[1].splitlines() if line.strip() != "…"]
    assert len(said) > 10
    assert {*said} <= {line.rstrip() for line in printed.splitlines()}


def test_analyse_a_log_counts_what_needs_work(growing_log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert analyse_a_log.main(str(growing_log)) == 1
    printed = capsys.readouterr().out
    assert printed.startswith("elevator: emergency")
    assert "friction 1." in printed


def test_analyse_a_log_says_why_undecided(growing_log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    profile = Path(__file__).parents[1] / "examples" / "profiles" / "csrv.toml"
    assert analyse_a_log.main(str(growing_log), str(profile)) == 0
    assert "because the profile has no [actuators.ema]" in capsys.readouterr().out


def _datagrams(log: Path, frames_each: int) -> list[tuple[int, bytes]]:
    """The log's frames, several to a datagram, and the time of each datagram in microseconds."""
    sent = [(time_us, frame) for time_us, _, frame in records(log.read_bytes())]
    return [
        (sent[k][0], b"".join(frame for _, frame in sent[k : k + frames_each]))
        for k in range(0, len(sent), frames_each)
    ]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="datagrams without loss are POSIX")
def test_follow_udp_prints_changes_as_they_come(
    growing_log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    datagrams = _datagrams(growing_log, 20)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    ours.settimeout(1.0)
    stamps = iter([stamp * 1000 for stamp, _ in datagrams])
    with ours, theirs:
        sender = threading.Thread(target=lambda: [theirs.send(datagram) for _, datagram in datagrams])
        sender.start()
        live = follow_udp.follow(ours, clock_ns=lambda: next(stamps))
        sender.join()
    assert "elevator: degraded → emergency" in capsys.readouterr().out
    conditions = {verdict.actuator: verdict.condition for verdict in live.verdicts}
    assert conditions == {
        "aileron_left": "normal",
        "aileron_right": "normal",
        "elevator": "emergency",
        "rudder": "normal",
    }
    assert not live.log.losses.any


def test_follow_udp_binds_a_port(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(follow_udp, "IDLE_S", 0.05)
    follow_udp.main(0, "paper")
    assert "no vehicle found" in capsys.readouterr().out


def test_a_datagram_is_cut_into_its_frames() -> None:
    plain = b"\xfd\x01\x00" + bytes(10)
    signed = b"\xfd\x01\x01" + bytes(23)
    old = b"\xfe\x02" + bytes(8)
    assert list(follow_udp.frames(plain + old + signed)) == [plain, old, signed]
    assert list(follow_udp.frames(b"noise")) == [b"noise"]


def test_quantities_go_into_pandas_and_a_plot(
    short_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = tmp_path / "quantities.png"
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    table = quantities_to_pandas.main(str(short_log), str(picture))
    assert list(table.index.unique("actuator")) == ["aileron_left", "aileron_right", "elevator", "rudder"]
    assert list(table.columns) == [f"V{k}" for k in range(1, 13)]
    printed = capsys.readouterr().out
    assert "V3 from DEBUG_FLOAT_ARRAY[EMA,3].data[2]" in printed
    assert "pip install matplotlib" in printed
    monkeypatch.undo()
    pytest.importorskip("matplotlib")
    quantities_to_pandas.plot(table, picture)
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_wear_over_flights_gives_the_flights_left(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = wear_over_flights.main(str(tmp_path), 16)
    assert not report.unshown
    worst = report.trends[0]
    assert worst.actuator == "elevator"
    assert worst.flights_left is not None
    # 0.225 N·m and 0.015 more in each of 15 flights make 0.45; 0.875 is reached 28.3 flights later.
    assert worst.flights_left.low <= 28.3 <= worst.flights_left.high < 31
    assert [one.flights_left for one in report.trends[1:]] == [None] * 3
    assert "elevator" in capsys.readouterr().out.splitlines()[0]
    assert report.flights == 16


def test_a_recording_of_ones_own(short_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = tmp_path / "lag.rrd"
    own_recording.main(str(short_log), str(recording))
    assert recording.read_bytes().startswith(b"RRF")
    assert "elevator: up to" in capsys.readouterr().out


@pytest.mark.slow
def test_the_ten_hours_of_the_picture_are_one_flight(tmp_path: Path) -> None:
    log = tmp_path / "ten-hours.tlog"
    pictures.write_ten_hours(log, hour_s=200.0)
    assessment = analyse(log)
    assert assessment.log.duration_s == pytest.approx(2000, abs=1)
    assert not assessment.log.losses.any
    elevator = next(verdict for verdict in assessment.verdicts if verdict.actuator == "elevator")
    assert (elevator.condition, elevator.coverage.late) == ("degraded", 0)
    assert elevator.since is not None
    assert elevator.since.flight_time_s == pytest.approx(1200, abs=30)


_WITHOUT = """
import runpy, sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {"rerun", "rerun_cli", "PIL", "sklearn", "torch"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.mark.parametrize(
    ("name", "extra"),
    [("own_recording", "viewer"), ("picture", "viewer"), ("selectors_in_a_pipeline", "train")],
)
def test_a_missing_extra_is_one_line(name: str, extra: str, short_log: Path, tmp_path: Path) -> None:
    example = Path(__file__).parents[1] / "examples" / f"{name}.py"
    command = [sys.executable, "-c", _WITHOUT, str(example), str(short_log), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=example.parents[1])
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert f"mavhums[{extra}]" in done.stderr.splitlines()[-1]
