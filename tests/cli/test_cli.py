"""The command line as a user meets it: what it prints, what it writes, what it exits with."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest
from fastcrc import crc16

from mavhums.cli import output
from mavhums.core.errors import ExitCode
from mavhums.learn import load_model
from mavhums.results.assessment import json_schema
from mavhums_sim import fly
from tests.conftest import SINGLE, Run, real_logs
from tests.logs import write_log
from tests.present import present


def test_analyse_prints_the_worst_first(run: Run, growing_log: Path) -> None:
    outcome = run("analyse", growing_log)
    assert outcome.code == ExitCode.EMERGENCY
    assert outcome.err == ""
    assert outcome.out.index("elevator") < outcome.out.index("rudder")
    assert "Not an airworthiness decision" in " ".join(outcome.out.split())
    assert "\x1b[" not in outcome.out


def test_analyse_json_follows_the_schema(run: Run, growing_log: Path, healthy_log: Path) -> None:
    validator = jsonschema.Draft202012Validator(json_schema())
    one = run("analyse", healthy_log, "--json")
    assert one.code == ExitCode.OK
    validator.validate(json.loads(one.out))
    two = run("analyse", healthy_log, growing_log, "--json")
    assert two.code == ExitCode.EMERGENCY
    whole = json.loads(two.out)
    assert whole["schema"] == "mavhums.assessment/2"
    assert [a["log"]["path"] for a in whole["assessments"]] == [str(healthy_log), str(growing_log)]
    for assessment in whole["assessments"]:
        validator.validate(assessment)


def test_markdown_says_what_the_text_says_and_names_no_folder(
    run: Run, growing_log: Path, healthy_log: Path, tmp_path: Path
) -> None:
    one = run("analyse", growing_log, "--markdown", "--rrd", tmp_path / "flight.rrd")
    assert one.code == ExitCode.EMERGENCY
    assert one.out.startswith("# EMERGENCY: elevator (servo 3): friction ")
    assert "rrd" not in one.out
    said = re.findall(r"[^\W\d_]{4,}", run("analyse", growing_log).out)
    assert {word.lower() for word in said} <= {*re.findall(r"[^\W\d_]+", one.out.lower())}
    missing = tmp_path / "gone" / growing_log.name
    several = run("analyse", healthy_log, growing_log, missing, "--markdown")
    assert several.code == ExitCode.EMERGENCY
    assert f"\n\n*{growing_log.name}*\n" in several.out
    assert f"| {growing_log.name} | unreadable | no such file | 1 |" in several.out
    assert not [path for path in (growing_log, healthy_log, missing) if str(path.parent) in several.out]


def test_analyse_writes_recordings(run: Run, growing_log: Path, healthy_log: Path, tmp_path: Path) -> None:
    one = tmp_path / "flight.rrd"
    outcome = run("analyse", growing_log, "--rrd", one)
    assert outcome.code == ExitCode.EMERGENCY
    assert one.read_bytes().startswith(b"RRF")
    assert f"rerun --bind 127.0.0.1 {one}" in outcome.out
    folder = tmp_path / "recordings"
    assert run("analyse", growing_log, healthy_log, "--rrd", folder).code == ExitCode.EMERGENCY
    assert sorted(path.name for path in folder.iterdir()) == ["growing.rrd", "healthy.rrd"]


@pytest.mark.slow
def test_open_starts_the_viewer(
    run: Run, healthy_log: Path, growing_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[list[str]] = []
    monkeypatch.setattr(subprocess, "Popen", started.append)
    recording = tmp_path / "flight.rrd"
    assert run("analyse", healthy_log, "--rrd", recording, "--open").code == ExitCode.OK
    [[program, *bind, opened]] = started
    assert bind == ["--bind", "127.0.0.1"]
    assert Path(program).is_file()  # the viewer beside this Python, whatever is on the PATH
    assert opened == str(recording)

    def fail(_: list[str]) -> None:
        raise FileNotFoundError

    monkeypatch.setattr(subprocess, "Popen", fail)
    outcome = run("analyse", growing_log, "--rrd", recording, "--open")
    assert outcome.code == ExitCode.EMERGENCY  # the alarm's exit code, not the viewer's
    assert "the Rerun viewer cannot be started" in outcome.err

    monkeypatch.setitem(sys.modules, "rerun_cli", None)
    outcome = run("analyse", growing_log, "--rrd", recording, "--open")
    assert outcome.code == ExitCode.EMERGENCY
    assert "pip install 'mavhums[viewer]'" in outcome.err


def test_inspect_names_tier_sources_and_rates(run: Run, growing_log: Path) -> None:
    outcome = run("inspect", growing_log)
    assert outcome.code == ExitCode.OK
    assert "telemetry tier instrumented" in outcome.out
    assert "DEBUG_FLOAT_ARRAY[EMA" in outcome.out
    assert "Log losses: none." in outcome.out
    inspected = json.loads(run("inspect", growing_log, "--json").out)
    rates = {row["name"]: row["rate_hz"] for row in inspected["messages"]}
    assert rates["DEBUG_FLOAT_ARRAY"] == pytest.approx(400, rel=0.01)
    assert rates["HEARTBEAT"] == pytest.approx(1, rel=0.05)


@pytest.mark.slow
def test_inspect_counts_what_mavlogdump_counts(run: Run, growing_log: Path) -> None:
    from collections import Counter

    from pymavlink import mavutil

    theirs: Counter[str] = Counter()
    connection = mavutil.mavlink_connection(str(growing_log))
    while (message := connection.recv_match()) is not None:
        theirs[message.get_type()] += 1
    connection.close()
    inspected = json.loads(run("inspect", growing_log, "--json").out)
    assert {row["name"]: row["count"] for row in inspected["messages"]} == theirs


def test_inspect_names_the_remedy_where_health_cannot_be_judged(run: Run, tmp_path: Path) -> None:
    from pymavlink.dialects.v20 import ardupilotmega as v2

    pulses = v2.MAVLink_servo_output_raw_message(0, 0, *[1500] * 16)
    pwm = run("inspect", write_log(tmp_path / "pwm.tlog", [pulses]))
    assert pwm.out.startswith("Nothing can be judged"), "the answer first"
    assert "  what to do: record each servo's ESC telemetry" in pwm.out
    assert "DEBUG_FLOAT_ARRAY named EMA" in pwm.out
    partial = [1.0, float("nan"), 3.0] + [float("nan")] * 9 + [0.0] * 46
    some = v2.MAVLink_debug_float_array_message(0, b"EMA", 3, partial)
    instrumented = write_log(tmp_path / "ema.tlog", [some])
    assert "no airframe profile" in run("inspect", instrumented).out.replace("\n", " ")
    named = run("inspect", instrumented, "--airframe", "paper").out
    assert re.search(r"V3 output shaft angle, ° +elevator +DEBUG_FLOAT_ARRAY\[EMA", named)
    assert "elevator: the log lacks V2, V4, V5, V6" in named
    assert "aileron_left, aileron_right and rudder: undecided: the log's instrumented" in named
    station = v2.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    nobody = run("inspect", write_log(tmp_path / "gcs.tlog", [station]))
    assert nobody.out.startswith("Nothing can be judged: no vehicle speaks")


def test_unknown_messages_are_named(run: Run, growing_log: Path, tmp_path: Path) -> None:
    content = growing_log.read_bytes()
    first = 20 + content[9]
    head = bytes([1, 0, 0, content[12] + 1, 1, 1, 1, 2, 200, 5])
    crc = crc16.mcrf4xx(head + bytes([77]))
    path = tmp_path / "unknown.tlog"
    unknown = content[:8] + b"\xfd" + head + crc.to_bytes(2, "little")
    path.write_bytes(content[:first] + unknown + content[first:])
    assert "1 frames of messages that the dialect does not define" in run("inspect", path).out


@pytest.mark.slow
def test_train_writes_a_model_that_analyse_uses(
    run: Run, growing_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch")
    shorter = lambda flight: fly(replace(flight, duration_s=40.0))  # noqa: E731
    monkeypatch.setattr("mavhums.paper.flights.fly", shorter)
    model = tmp_path / "model.safetensors"
    trained = run("train", "--flights", "2", "--networks", "2", "--vectors", "500", "-o", model)
    assert trained.code == 0
    assert "wrapper: " in trained.out
    assert "flights not trained on: " in trained.out
    assert "expected calibration error" in trained.out
    assessment = json.loads(run("analyse", growing_log, "--model", model, "--json").out)
    elevator = next(v for v in assessment["verdicts"] if v["actuator"] == "elevator")
    assert assessment["model"]["hash"] == load_model(model).hash
    assert elevator["network"]["latest"], "which class it is depends on the processor's last digits"


def test_progress_is_shown_on_a_terminal_only(
    run: Run, growing_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    big = tmp_path / "big.tlog"
    big.write_bytes(growing_log.read_bytes() * 4)
    assert run("inspect", big).err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with output.reading(big) as progress:
        present(progress)(10)
    with output.steps("training") as steps:
        present(steps)(1, 2)


@pytest.mark.parametrize(
    ("command", "teaches"), [([], "mavhums analyse flight.tlog"), (["inspect"], "--json")]
)
def test_help_teaches_and_is_instant(command: list[str], teaches: str) -> None:
    program = [sys.executable, "-X", "importtime", "-m", "mavhums", *command, "--help"]
    outcome = subprocess.run(program, capture_output=True, text=True, check=True)
    assert teaches in outcome.stdout
    loaded = {line.split("|")[-1].strip() for line in outcome.stderr.splitlines()}
    heavy = {"numpy", "pandas", "torch", "rerun", "pymavlink", "scipy", "numba", "pydantic", "rich"}
    assert not loaded & heavy


def test_interruption_leaves_nothing_half_written(
    run: Run, growing_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("mavhums.engine.engine.Engine.finish", interrupt)
    outcome = run("analyse", growing_log, "--rrd", tmp_path / "flight.rrd")
    assert outcome.code == 130
    assert "stopped" in outcome.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("path", real_logs(*SINGLE), ids=lambda path: path.name)
@pytest.mark.parametrize("command", ["analyse", "inspect"])
def test_real_files_never_end_in_a_traceback(run: Run, command: str, path: Path) -> None:
    outcome = run(command, path)
    assert "Traceback" not in outcome.err
    if path.name == "log171.bin":  # older than ArduPilot's microseconds
        assert outcome.code == ExitCode.ERROR
        assert len(outcome.err.splitlines()) == 2
        return
    assert outcome.err == ""
    read = {ExitCode.OK, ExitCode.READ_WITH_LOSSES}
    # Software in the loop: a jammed aileron, and motors that are overridden.
    faulty = path.name in ("plane_lua_csrv.link1.tlog", "hexa_real.bin")
    judged = {ExitCode.EMERGENCY} if faulty else {ExitCode.UNDECIDED, *read}
    assert outcome.code in (judged if command == "analyse" else read)
