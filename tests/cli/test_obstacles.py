"""The obstacle that is named is the one in the way, and inspect and analyse agree on it."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import zstandard
from pymavlink.dialects.v20 import ardupilotmega as v2

import mavhums
from examples import analyse_a_log, own_recording, quantities_to_pandas
from mavhums.actuator.draft import draft_profile
from mavhums.core.errors import ExitCode
from tests.conftest import REAL_LOGS, Run, needs
from tests.logs import write_log

FIXED_WING, QUADROTOR = 1, 2


def sent(kind: int, *, esc: bool, pulses: bool = True, parameters: bool = False) -> list[Any]:
    """Return what a vehicle of ArduPilot sends: an ESC on output 1, if any, that turns a propeller."""
    out: list[Any] = [
        v2.MAVLink_heartbeat_message(kind, 3, 0, 0, 4, 3),
        v2.MAVLink_statustext_message(6, b"ArduPlane V4.5.7 (0fe2a2b6)"),
        v2.MAVLink_attitude_message(0, *[0.0] * 6),
    ]
    if parameters:
        values = {"SERVO2_FUNCTION": 19, "SERVO2_MIN": 1000, "SERVO2_TRIM": 1500, "SERVO2_MAX": 2000}
        out += [v2.MAVLink_param_value_message(k.encode(), float(v), 9, 4, 0) for k, v in values.items()]
    for k in range(40):
        if pulses:
            out.append(v2.MAVLink_servo_output_raw_message(20_000 * k, 0, *[1500 + k] * 16))
        if esc:
            row = [[0, 0, 0, 0], [1200, 0, 0, 0], [300, 0, 0, 0], [0] * 4, [5000, 0, 0, 0], [0] * 4]
            out.append(v2.MAVLink_esc_telemetry_1_to_4_message(*row))
    return out


def both(run: Run, log: Path, *arguments: str | Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what inspect says of the vehicle and analyse of its actuators."""
    vehicle = json.loads(run("inspect", log, "--json", *arguments).out)["vehicles"][0]
    verdict = json.loads(run("analyse", log, "--json", *arguments).out)["verdicts"][0]
    return vehicle, verdict


def test_one_heartbeat_names_the_vehicle(run: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "x.tlog", [v2.MAVLink_heartbeat_message(FIXED_WING, 12, 0, 0, 4, 3)], system=9)
    vehicle, verdict = both(run, log)
    assert (vehicle["vehicle"], vehicle["kind"], vehicle["autopilot"]) == (9, "fixed wing", "PX4")
    assert (verdict["vehicle"], verdict["reason_codes"]) == (9, ["nothing_of_actuators"])
    assert verdict["reason"].startswith("fixed wing, PX4: ")
    assert "no vehicle speaks" not in run("analyse", log).out


def test_a_propellers_esc_is_named_as_such(run: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "x.tlog", sent(FIXED_WING, esc=True, parameters=True))
    vehicle, verdict = both(run, log)
    assert vehicle["tier"] == verdict["tier"] == "esc-unsigned"
    assert verdict["reason_codes"] == ["no_profile_of_esc"]
    profile = tmp_path / "mine.toml"
    profile.write_text(draft_profile(log).replace("# travel_deg = ", "travel_deg = [-20, 20]  #"))
    vehicle, verdict = both(run, log, "--airframe", profile)
    assert vehicle["tier"] == verdict["tier"] == "pwm"
    assert run("inspect", log, "--airframe", profile).out.startswith("Nothing can be judged")


def test_a_multirotor_has_no_surfaces_as_its_reason(run: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "x.tlog", sent(QUADROTOR, esc=True))
    _, verdict = both(run, log)
    assert run("inspect", log).out.startswith("Nothing can be judged")
    # Its motors are what it is judged by, and this log has no parameters.
    assert (verdict["subject"], verdict["condition"]) == ("motor", "undecided")
    assert verdict["reason_codes"] == ["motors_unknown"]


def test_a_fresh_draft_says_what_it_lacks(run: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "x.tlog", sent(FIXED_WING, esc=False, parameters=True))
    profile = tmp_path / "mine.toml"
    profile.write_text(draft_profile(log))
    _, verdict = both(run, log, "--airframe", profile)
    printed = run("inspect", log, "--airframe", profile).out
    for text in (verdict["reason"], printed):
        assert "travel_deg" in text.replace("\n", " ")
    outcome = run("export", log, "-o", tmp_path / "v.csv", "--airframe", profile)
    assert "has no travel_deg, without which a pulse has no angle" in outcome.err
    assert "--messages SERVO_OUTPUT_RAW" in outcome.err


def test_export_without_a_profile_writes_what_the_log_carries(run: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "x.tlog", sent(FIXED_WING, esc=True))
    assert run("export", log, "-o", tmp_path / "v.csv").code == 0
    table = pd.read_csv(tmp_path / "v.csv")
    assert set(table["output"]) == {"esc_0"}
    assert len(table) == 40
    assert set(table["V7"]) == {5000.0}
    only = write_log(tmp_path / "y.tlog", sent(FIXED_WING, esc=False))
    assert "--messages SERVO_OUTPUT_RAW" in run("export", only, "-o", tmp_path / "w.csv").err
    assert not (tmp_path / "w.csv").exists()


@pytest.mark.parametrize(
    ("module", "command", "extra"),
    [
        ("fastapi", ["serve", "--port", "0"], "serve"),
        ("mcp.server.mcpserver", ["mcp"], "mcp"),
        ("pyarrow.parquet", ["export", "LOG", "-o", "TABLE"], "arrow"),
        ("zstandard", ["inspect", "PACKED"], "zstd"),
    ],
)
def test_a_missing_extra_is_one_line_with_its_installation(
    run: Run,
    short_log: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    module: str,
    command: list[str],
    extra: str,
) -> None:
    packed = tmp_path / "flight.tlog.zst"
    packed.write_bytes(zstandard.compress(short_log.read_bytes()))
    monkeypatch.setitem(sys.modules, module, None)
    named = {"LOG": short_log, "TABLE": tmp_path / "t.parquet", "PACKED": packed}
    outcome = run(*(named.get(one, one) for one in command))
    assert outcome.code == ExitCode.ERROR
    assert f"pip install 'mavhums[{extra}]'" in outcome.err
    assert len(outcome.err.splitlines()) == 2


@needs(REAL_LOGS / "onboard")
@pytest.mark.parametrize(("name", "message"), [("dani1.BIN", "RCOU"), ("sample.ulg", "actuator_outputs")])
def test_export_suggests_a_message_of_the_logs_own_format(
    run: Run, tmp_path: Path, name: str, message: str
) -> None:
    refused = run("export", REAL_LOGS / "onboard" / name, "-o", tmp_path / "w.csv")
    assert f"--messages {message}" in refused.err


def test_examples_refuse_a_log_without_telemetry(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_log(tmp_path / "x.tlog", sent(FIXED_WING, esc=False))
    assert analyse_a_log.main(str(log)) == 0
    draft = tmp_path / "mine.toml"
    known = write_log(tmp_path / "y.tlog", sent(FIXED_WING, esc=False, parameters=True))
    draft.write_text(draft_profile(known))
    for airframe in (None, str(draft)):
        with pytest.raises(mavhums.MavhumsError):
            quantities_to_pandas.main(str(log), str(tmp_path / "p.png"), airframe)
        with pytest.raises(mavhums.MavhumsError):
            own_recording.main(str(log), str(tmp_path / "p.rrd"), airframe)
    own_recording.main(str(log), str(tmp_path / "p.rrd"), "paper")
    assert "nan" not in capsys.readouterr().out


@pytest.mark.parametrize(
    "name", ["analyse_a_log", "follow_udp", "own_recording", "quantities_to_pandas", "wear_over_flights"]
)
def test_examples_without_an_argument_say_how_to_call_them(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    import runpy

    path = Path(__file__).parents[2] / "examples" / f"{name}.py"
    monkeypatch.setattr(sys, "argv", [str(path)])
    with pytest.raises(SystemExit, match=f"usage: {name}.py"):
        runpy.run_path(str(path), run_name="__main__")
