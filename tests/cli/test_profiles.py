"""Profiles drafted from logs, and profiles that map fields of their own."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2

import mavhums
from mavhums.actuator.draft import draft_profile
from mavhums.actuator.profile import Actuator, load_airframe
from mavhums.app.sinks import Events
from mavhums.core.errors import ExitCode
from mavhums.health.decision.events import ConditionChanged
from mavhums.vehicle.parameters import control_surfaces, read_parameters
from mavhums_sim import Flight, fly, write_tlog
from tests.conftest import REAL_LOGS, Run, needs, real_logs
from tests.logs import heartbeat, write_log

CSRV = Path(__file__).parents[2] / "examples" / "profiles" / "csrv.toml"
CSRV_LOG = REAL_LOGS / "sitl" / "plane_lua_csrv.link1.tlog"


def ardupilot(**values: float) -> list[Any]:
    """The parameters as ArduPilot sends them: numbers, whatever their type."""
    sent = [v2.MAVLink_param_value_message(n.encode(), x, 4, len(values), 0) for n, x in values.items()]
    return [heartbeat(3), *sent]


def px4(**values: float) -> list[Any]:
    """The parameters as PX4 sends them: the bits of integers in the place of the float."""
    sent = []
    for name, value in values.items():
        is_integer = isinstance(value, int)
        number = struct.unpack("<f", struct.pack("<i", value))[0] if is_integer else value
        kind = 6 if is_integer else 9
        sent.append(v2.MAVLink_param_value_message(name.encode(), number, kind, len(values), 0))
    return [*sent, heartbeat(12)]


SERVOS: list[dict[str, float]] = [
    {"FUNCTION": 4, "MIN": 1100, "TRIM": 1520, "MAX": 1900},
    {"FUNCTION": 19, "REVERSED": 1},
    {"FUNCTION": 70},
    {"FUNCTION": 4, "MIN": 1000, "TRIM": 990, "MAX": 2000},
    {"FUNCTION": 33},
    {"FUNCTION": 79, "MIN": 1900, "MAX": 1100},
]
PLANE = {f"SERVO{k}_{name}": value for k, one in enumerate(SERVOS, 1) for name, value in one.items()}


def drafted(text: str, tmp_path: Path) -> tuple[Actuator, ...]:
    path = tmp_path / "drafted.toml"
    path.write_text(text, encoding="utf-8")
    return load_airframe(path).actuators


def test_a_draft_names_the_control_surfaces_of_ardupilot(tmp_path: Path) -> None:
    log = write_log(tmp_path / "plane.tlog", ardupilot(**PLANE))
    text = draft_profile(log)
    actuators = drafted(text, tmp_path)
    assert [(a.name, a.surface, a.servo, a.pwm_us) for a in actuators] == [
        ("aileron_1", "aileron", 1, (1100, 1520, 1900)),
        ("elevator", "elevator", 2, (1100, 1500, 1900)),
        ("aileron_4", "aileron", 4, (1000, 1500, 2000)),
        ("left_v_tail", "left v-tail", 6, (1100, 1500, 1900)),
    ]
    assert all(a.blanks and a.travel_deg is None and a.esc is None for a in actuators)
    lines = text.splitlines()
    assert 'name = "plane"' in lines
    assert "servo = 1  # SERVO1_FUNCTION = 4" in lines
    assert "pwm_us = [1100, 1520, 1900]  # SERVO1_MIN, SERVO1_TRIM, SERVO1_MAX" in lines
    assert "reversed" in next(line for line in lines if "the log does not contain them" in line)
    assert any("SERVO4_MIN, SERVO4_TRIM, SERVO4_MAX; zero in the middle" in line for line in lines)
    assert any("CHECK: SERVO6_MIN = 1900 is not below SERVO6_MAX = 1100" in line for line in lines)
    assert text.count("FILL IN") == 1 + 3 * 4


def test_a_draft_decodes_the_integers_of_px4(tmp_path: Path) -> None:
    outputs = {f"PWM_MAIN_FUNC{k}": function for k, function in enumerate((201, 101, 202, 203, 204), 1)}
    kinds = {f"CA_SV_CS{k}_TYPE": kind for k, kind in enumerate((1, 3, 16))}
    pulses = {"PWM_MAIN_MIN1": 1050, "PWM_MAIN_MAX1": 1950, "PWM_MAIN_REV": 4}
    log = write_log(tmp_path / "px4.tlog", px4(**outputs, **kinds, **pulses, CA_SV_CS0_TRIM=0.1))
    text = draft_profile(log, name="my plane")
    assert [(a.name, a.servo, a.pwm_us) for a in drafted(text, tmp_path)] == [
        ("left_aileron", 1, (1050, 1500, 1950)),
        ("elevator", 3, (1000, 1500, 2000)),
        ("servo_4", 5, (1000, 1500, 2000)),
    ]
    assert load_airframe(tmp_path / "drafted.toml").name == "my plane"
    reversed_lines = [line for line in text.splitlines() if "; reversed" in line]
    assert len(reversed_lines) == 1
    assert read_parameters(log).values["CA_SV_CS0_TRIM"] == pytest.approx(0.1)


def test_the_last_value_of_a_parameter_counts_and_a_broken_one_does_not(tmp_path: Path) -> None:
    sent = [*ardupilot(SERVO1_FUNCTION=4, SERVO1_MIN=float("nan")), *ardupilot(SERVO1_FUNCTION=21)]
    [output] = control_surfaces(read_parameters(write_log(tmp_path / "twice.tlog", sent)))
    assert (output.surface, output.pwm_us) == ("rudder", (1100, 1500, 1900))


def test_a_strange_name_is_written_so_that_it_can_be_read_back(tmp_path: Path) -> None:
    log = write_log(tmp_path / "plane.tlog", ardupilot(**PLANE))
    for name in ('a "quoted" \\ name', "Möwe ✈", "two\nlines\x7f"):
        drafted(draft_profile(log, name=name), tmp_path)
        read = load_airframe(tmp_path / "drafted.toml").name
        assert read == name.replace("\n", "?").replace("\x7f", "?")


def test_profile_new_writes_or_prints_but_never_overwrites(run: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "plane.tlog", ardupilot(**PLANE))
    mine = tmp_path / "mine.toml"
    outcome = run("profile", "new", log, "-o", mine)
    assert outcome.code == 0
    assert "drafted 4 actuators" in outcome.out
    assert "fill in: travel_deg, [actuators.ema] and [actuators.limits]" in outcome.out
    assert run("profile", "new", log).out == mine.read_text(encoding="utf-8")
    again = run("profile", "new", log, "-o", mine)
    assert again.code == ExitCode.ERROR
    assert "exists already" in again.err
    nowhere = run("profile", "new", log, "-o", tmp_path / "no" / "mine.toml")
    assert nowhere.code == ExitCode.ERROR
    assert "cannot write" in nowhere.err


@pytest.mark.parametrize(
    ("sent", "message"),
    [
        ([heartbeat(3)], "contains no parameters"),
        (ardupilot(FENCE_TYPE=1), "none of its 1 parameters assigns an output (SERVOn_FUNCTION)"),
        (px4(PWM_MAIN_FUNC1=101), "none of the 1 outputs that its parameters assign moves a control surface"),
        (px4(BAT_N=1), "(PWM_MAIN_FUNCn, PWM_AUX_FUNCn, UAVCAN_SV_FUNCn)"),
    ],
)
def test_what_cannot_be_drafted_is_said(run: Run, tmp_path: Path, sent: list[Any], message: str) -> None:
    outcome = run("profile", "new", write_log(tmp_path / "other.tlog", sent))
    assert outcome.code == ExitCode.ERROR
    assert message in outcome.err
    assert "remedy: " in outcome.err


def test_of_several_vehicles_one_is_chosen(run: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "two.tlog", ardupilot(SERVO1_FUNCTION=4))
    write_log(log, ardupilot(SERVO2_FUNCTION=21), system=7)
    assert "vehicles 1, 7" in run("profile", "new", log).err
    assert 'surface = "rudder"' in run("profile", "new", log, "--vehicle", "7").out
    assert "no parameters of vehicle 3" in run("profile", "new", log, "--vehicle", "3").err


def test_a_draft_keeps_what_the_log_names(run: Run, growing_log: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    assert "the profile that the log names" in run("profile", "new", growing_log, "-o", mine).out
    before, after = (mavhums.analyse(growing_log, airframe=one).verdicts for one in (None, mine))
    assert [verdict.condition for verdict in before] == [verdict.condition for verdict in after]
    assert load_airframe(mine).name == "paper"
    assert 'name = "my plane"' in draft_profile(growing_log, name="my plane")


@pytest.mark.slow
def test_a_draft_shows_the_quantities_and_compares_with_the_own_past_alone(
    run: Run, growing_log: Path, tmp_path: Path
) -> None:
    # The text that names a profile is damaged on the way.
    log = tmp_path / "unnamed.tlog"
    log.write_bytes(growing_log.read_bytes().replace(b"airframe=paper", b"airframe=other"))
    mine = tmp_path / "mine.toml"
    assert run("profile", "new", log, "-o", mine).code == 0
    assessment = mavhums.analyse(log, mavhums.Options(airframe=mine))
    actuators = [verdict for verdict in assessment.verdicts if verdict.subject == "actuator"]
    assert len(actuators) == 4
    for verdict in actuators:
        assert verdict.condition == verdict.worst == "learning"
        assert verdict.reason_codes == ("own_learning",)
        assert len(verdict.provenance) == 12
    outcome = run("analyse", log, "--airframe", mine, "--rrd", tmp_path / "draft.rrd")
    assert outcome.code == ExitCode.UNDECIDED
    assert "flight 1 of the 10" in outcome.out
    assert (tmp_path / "draft.rrd").exists()
    assert "the log lacks V" not in run("inspect", log, "--airframe", mine).out


def test_without_constants_what_an_esc_says_is_shown_as_it_is(tmp_path: Path) -> None:
    log = tmp_path / "esc.tlog"
    write_tlog(fly(Flight(seed=3, duration_s=12.0, tiers=("esc-unsigned",))), log)
    whole = load_airframe("paper")
    draft = [a.model_copy(update={"ema": None, "limits": None}) for a in whole.actuators]
    draft[1] = draft[1].model_copy(update={"esc_side": "bus"})
    mine = whole.model_copy(update={"actuators": tuple(draft)})
    histories = mavhums.actuators(mavhums.read_log(log), mine)
    left, right = histories["aileron_left"], histories["aileron_right"]
    assert left.frame["V7"].min() >= 0
    assert left.frame["V7"].max() > 100
    assert "without its sign" in left.provenance["V7"]
    assert left.frame[["V3", "V8", "V10"]].isna().all(axis=None)
    assert "ESC_TELEMETRY_1_TO_4[1].current" in right.provenance["V5"]


@needs(CSRV_LOG)
def test_the_times_of_a_jam_agree_in_event_and_evidence() -> None:
    events: list[ConditionChanged] = []
    assessment = mavhums.analyse(
        CSRV_LOG,
        mavhums.Options(airframe=CSRV),
        sinks=[Events(lambda block: events.extend(e for e in block if isinstance(e, ConditionChanged)))],
    )
    [jam] = next(v for v in assessment.verdicts if v.actuator == "aileron_1").evidence
    own = [event for event in events if event.actuator == "aileron_1"]
    assert [event.since_s for event in own] == [jam.start_s, jam.end_s]
    assert [jam.start_s, jam.end_s] == pytest.approx([90.0, 130.0], abs=2.0)  # 60 to 100 s in the air


PLANES = [path for path in real_logs() if path.name.startswith(("plane_", "Jordinaa", "EAICS__flight.tlog"))]


@needs(REAL_LOGS)
@pytest.mark.parametrize("log", [p for p in PLANES if p.suffix == ".tlog"], ids=lambda path: path.name)
def test_the_draft_of_a_real_log_can_be_used_at_once(run: Run, log: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    assert run("profile", "new", log, "-o", mine).code == 0
    actuators = load_airframe(mine).actuators
    assert {"aileron", "elevator", "rudder"} <= {a.surface.removeprefix("left ") for a in actuators}
    outcome = run("analyse", log, "--airframe", mine)
    # Their ESCs drive propellers: only the axes can be judged.
    judged = {"plane_lua_csrv": ExitCode.EMERGENCY, "plane_hirate": ExitCode.OK, "plane_normal": ExitCode.OK}
    assert outcome.code == judged.get(log.name.split(".")[0], ExitCode.UNDECIDED)
