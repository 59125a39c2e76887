"""A profile that the log contradicts: never an emergency, from no format, however late the log records it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mavhums
from mavhums.actuator.profile import Actuator, Airframe, load_airframe
from mavhums.core.errors import ExitCode
from mavhums.engine.events import Event, Notice
from mavhums.engine.moving_outputs import contradiction, inferred, refutation
from mavhums.health.decision.events import ConditionChanged
from mavhums.results.assessment import Assessment
from mavhums.results.sections import AxisLimits
from mavhums.results.verdict import Verdict
from mavhums.vehicle.facts import ALL_OUTPUTS
from mavhums.vehicle.surfaces import SurfaceOutput
from mavhums_sim import Flight, fly, write_dataflash, write_tlog
from tests.conftest import REAL_LOGS, Run, needs
from tests.engine.wired import PLANE, PX4_PLANE, Wired
from tests.fleet_logs import records
from tests.health.axis.flights import excited, rows, steady
from tests.judge import judged

PAPER = load_airframe("paper")
NAMED = (b"mavhums airframe=paper",)
PARAM_VALUE = 22
FORMATS: dict[str, Callable[[Wired], bytes]] = {
    "tlog": Wired.tlog,
    "BIN": Wired.dataflash,
    "ulg": lambda flight: replace(flight, parameters=PX4_PLANE if flight.parameters else {}).ulog(),
}
ALFA = Path(__file__).parents[2] / "benchmarks" / "alfa.toml"
NO_ALARM = {"normal", "unchanged", "undecided", "unmonitored"}
WRONG = "servo 2 is right aileron in the profile and elevator in the log"


def by_profile(
    log: bytes, airframe: Airframe | None = PAPER
) -> tuple[dict[str, Verdict], list[Event], Assessment]:
    assessment, events = judged(log, airframe=airframe)
    return {verdict.actuator: verdict for verdict in assessment.verdicts}, events, assessment


def alarms(events: Iterable[Event]) -> list[ConditionChanged]:
    return [e for e in events if isinstance(e, ConditionChanged) and e.after in ("degraded", "emergency")]


@pytest.mark.slow
@pytest.mark.parametrize("kind", FORMATS)
def test_what_the_parameters_contradict_is_judged_by_them(kind: str) -> None:
    verdicts, events, assessment = by_profile(FORMATS[kind](Wired()))
    assert not alarms(events)
    wrong = verdicts["aileron_right"]
    assert (wrong.condition, wrong.worst) == ("undecided", "undecided")
    assert WRONG in str(wrong.reason)
    assert wrong.reason_codes == ("contradicts",)
    roll = verdicts["roll"]
    assert (roll.condition, roll.surfaces) == ("unchanged", ("aileron (servo 1)",))
    assert "the log's parameters, which contradict the airframe profile" in roll.provenance["V1"]
    assert roll.indicators == (), "its scale is not that of the profile's flights"
    assert verdicts["aileron_left"].condition == "unmonitored"
    assert assessment.log.notices == (
        "roll, pitch: judged by the log's parameters, which contradict the profile",
    )
    assert assessment.exit_code is ExitCode.UNDECIDED


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "sent_s"), [("tlog", 30.0), ("tlog", 130.0), ("BIN", 80.0), ("ulg", 168.0)])
def test_parameters_that_arrive_late_contradict_as_well(kind: str, sent_s: float) -> None:
    verdicts, events, _ = by_profile(FORMATS[kind](Wired(sent_s=sent_s)))
    assert not alarms(events)
    assert {verdict.worst for verdict in verdicts.values()} <= NO_ALARM
    assert WRONG in str(verdicts["aileron_right"].reason)
    assert verdicts["roll"].condition == "unchanged", "the whole flight is judged anew by the parameters"


@pytest.mark.slow
@pytest.mark.parametrize("kind", FORMATS)
def test_without_parameters_the_motion_contradicts(kind: str) -> None:
    verdicts, events, _ = by_profile(FORMATS[kind](Wired(parameters={})))
    assert not alarms(events)
    said = "servo 2 does not move roll, servo 1 does: the profile may name the wrong output"
    assert verdicts["roll"].reason == said
    assert verdicts["yaw"].reason == said, "the side force of the ailerons is not known"
    assert verdicts["roll"].reason_codes == ("outputs_contradicted",)
    assert [event.text for event in events if isinstance(event, Notice)][-1:] == [said]


def named(**servos: int) -> Airframe:
    named = (Actuator(name=name, servo=n, pwm_us=(1100, 1500, 1900)) for name, n in servos.items())
    return Airframe(name="mine", actuators=tuple(named))


SWAPPED = named(aileron=4, elevator=2, rudder=1)


def corrected(flight: Wired, first: dict[str, float]) -> bytes:
    """A log that begins with other parameters than those that the flight reports."""
    early = records(replace(flight, parameters=first, sent_s=0.0).tlog())
    late = [record for record in records(flight.tlog()) if record[1][7] == PARAM_VALUE]
    both = sorted([*early, *late], key=lambda record: record[0])
    return b"".join(time_us.to_bytes(8, "big") + frame for time_us, frame in both)


@pytest.mark.slow
@pytest.mark.parametrize("airframe", [None, SWAPPED], ids=["parameters", "profile"])
def test_an_alarm_is_withdrawn_where_the_parameters_are_corrected_after_it(airframe: Airframe | None) -> None:
    """Until 100 s rudder and aileron move together, so that nothing shows which of them the log names."""
    wrong = {**PLANE, "SERVO1_FUNCTION": 21.0, "SERVO4_FUNCTION": 4.0}
    verdicts, events, _ = by_profile(corrected(Wired(coordinated_s=100.0, sent_s=140.0), wrong), airframe)
    changes = [e for e in events if isinstance(e, ConditionChanged) and e.actuator == "roll"]
    assert [change.after for change in changes][-2:] == ["emergency", "unchanged"]
    assert changes[-1].time_s == 150.0
    by_profile_ = "servo 4 is aileron in the profile and rudder in the log"
    assert (by_profile_ if airframe else "its parameters name other") in changes[-1].rule
    roll = verdicts["roll"]
    assert (roll.condition, roll.worst, roll.evidence) == ("unchanged", "unchanged", ())


@pytest.mark.slow
def test_an_alarm_that_only_a_wrong_profile_raises_is_not_reported() -> None:
    flight = Wired(coordinated_s=100.0, sent_s=140.0)
    verdicts, events, _ = by_profile(flight.tlog(), SWAPPED)
    assert not alarms(events)
    changes = [e for e in events if isinstance(e, ConditionChanged) and e.actuator == "roll"]
    assert [change.after for change in changes] == ["unchanged", "undecided", "unchanged"]
    assert "servo 4 does not move roll, servo 1 does" in changes[1].rule
    assert verdicts["roll"].worst == "unchanged"


@pytest.mark.slow
def test_a_wrong_profile_that_is_named_late_raises_no_alarm_of_the_past() -> None:
    """What was flown before the vehicle names its profile is judged by it, and the motion is asked."""
    flight = Wired(parameters={}, texts=NAMED, named_s=150.0)
    verdicts, events, _ = by_profile(flight.tlog(), None)
    assert not alarms(events)
    assert "servo 2 does not move roll" in str(verdicts["roll"].reason)


@pytest.mark.slow
def test_a_real_loss_is_found_whether_the_profile_is_right_or_not() -> None:
    right, lost = named(aileron=1, elevator=2, rudder=4), Wired(left=0.4)
    for airframe, parameters in ((right, lost.parameters), (right, {}), (PAPER, lost.parameters), (None, {})):
        verdicts, _, _ = by_profile(replace(lost, parameters=parameters).tlog(), airframe)
        assert verdicts["roll"].condition == "emergency", airframe
    verdicts, _, _ = by_profile(replace(lost, parameters={}).tlog(), PAPER)
    assert verdicts["roll"].reason_codes == ("outputs_contradicted",)


@pytest.mark.slow
def test_a_surface_lost_before_take_off_is_not_laid_on_a_profile_that_the_parameters_confirm() -> None:
    """The aircraft answers to the rudder alone: nothing but the parameters separates the two cases."""
    flight = Wired(left=0.0, lost_s=0)
    confirmed, _, _ = by_profile(flight.tlog(), named(aileron=1, elevator=2, rudder=4))
    assert confirmed["roll"].reason_codes == ("effect_uncertain",)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["tlog", "BIN"])
def test_the_telemetry_of_another_surface_is_no_verdict(tmp_path: Path, kind: str) -> None:
    """The elevator's friction is an emergency; the profile takes its output for the left aileron's."""
    tier = "esc-signed" if kind == "tlog" else "named"
    record = fly(Flight(seed=11, duration_s=40.0, friction_nm={"elevator": (1.2, 1.2)}, tiers=(tier, "pwm")))
    (write_tlog if kind == "tlog" else write_dataflash)(record, tmp_path / "flight")
    log = (tmp_path / "flight").read_bytes()
    right, _, _ = by_profile(log)
    assert {name for name, verdict in right.items() if verdict.worst == "emergency"} == {"elevator"}
    moved = {"aileron_left": 3, "elevator": 1}
    outputs = {one.name: moved.get(one.name, one.servo) for one in PAPER.actuators}
    swapped = [
        one.model_copy(update={"servo": outputs[one.name], "esc": outputs[one.name] - 1})
        for one in PAPER.actuators
    ]
    verdicts, _, assessment = by_profile(log, PAPER.model_copy(update={"actuators": tuple(swapped)}))
    assert assessment.exit_code is ExitCode.UNDECIDED
    for name in moved:
        found = verdicts[name]
        assert (found.condition, found.worst, found.evidence) == ("undecided", "undecided", ())
        assert found.reason_codes == ("contradicts",)
    assert verdicts["aileron_right"].condition == verdicts["rudder"].condition == "normal"


@pytest.mark.slow
def test_a_range_and_a_direction_are_said_and_the_axis_is_judged_by_the_log() -> None:
    ends = {"SERVO1_MIN": 1000.0, "SERVO1_MAX": 2000.0, "SERVO5_FUNCTION": 4.0, "SERVO5_REVERSED": 1.0}
    ends |= {"SERVO5_MIN": 1300.0, "SERVO5_MAX": 1700.0}
    all_ = {f"SERVO{n}_{part}": us for n in (1, 2, 4, 5) for part, us in (("MIN", 1100.0), ("MAX", 1900.0))}
    all_ |= {f"SERVO{n}_REVERSED": 0.0 for n in (1, 2, 4)}
    pair = named(aileron_left=1, aileron_right=5)
    narrow = {"pwm_us": (1300, 1500, 1700), "travel_deg": (-20, 20)}
    actuators = tuple(one.model_copy(update=narrow) for one in pair.actuators)
    airframe = pair.model_copy(update={"actuators": actuators})
    verdicts, _, assessment = by_profile(Wired(parameters={**PLANE, **all_, **ends}).tlog(), airframe)
    [notice, axes] = assessment.log.notices
    assert "servo 1 (aileron_left) has 1300 to 1700 µs in the profile and 1000 to 2000 µs" in notice
    assert "servos 1 and 5 (aileron_right) deflect the same way in the profile and opposite ways" in notice
    assert "correct pwm_us of aileron_left, travel_deg of aileron_right in the profile" in notice
    assert axes == "roll: judged by the log's parameters, which contradict the profile"
    assert (verdicts["roll"].condition, verdicts["aileron_left"].condition) == ("unchanged", "unmonitored")
    assert {one.servo: one.range_us for one in assessment.usage[0].outputs}[1] == (1000, 1500, 2000)


def test_no_log_is_offered_a_packaged_profile_that_it_does_not_name(run: Run, tmp_path: Path) -> None:
    """An ESC reports, so that a profile is what is missing; the paper's is another aircraft's."""
    log = tmp_path / "esc.tlog"
    write_tlog(fly(Flight(seed=3, duration_s=12.0, tiers=("esc-unsigned",))), log)
    log.write_bytes(log.read_bytes().replace(b"mavhums airframe=paper", b"mavhums nothing=here  "))
    for command in ("analyse", "inspect"):
        text = " ".join(run(command, log).out.split())
        assert "mavhums profile new" in text
        assert "one of: paper" not in text


def trial(demand: dict[int, np.ndarray], rate: np.ndarray, *servos: int) -> str | None:
    """What the motion says of a profile whose ailerons are these servos."""
    flight = steady(90)
    flight["roll_rate"] = rate
    flight["outputs"][:, 0] = np.mean([demand[servo] for servo in servos], axis=0)
    sent = np.full((len(rate), ALL_OUTPUTS), np.nan)
    for servo, share in demand.items():
        sent[:, servo - 1] = 1500 + 400 * share
    named = [SurfaceOutput(n, "aileron", 1500.0, 400.0) for n in servos]
    return contradiction(rows(flight), sent, "roll", named)


def test_without_a_roll_rate_no_output_is_inferred() -> None:
    """A log may have outputs and neither attitude nor rates; here a warning of numpy is an error."""
    flight, sent = steady(90), np.full((90 * 20, ALL_OUTPUTS), np.nan)
    demand = excited(90)
    sent[:, 0] = 1500 + 400 * demand
    for rate, servos in ((2.2 * demand, [1]), (np.full(demand.size, np.nan), [])):
        found = inferred(rows({**flight, "roll_rate": rate}), sent)
        assert [one.servo for one in (found.moved if found else ())] == servos


@pytest.mark.slow
@given(seed=st.integers(0, 10_000), noise=st.floats(0.0, 0.05))
@settings(max_examples=2, deadline=None)
def test_the_motion_contradicts_wrong_outputs_alone(seed: int, noise: float) -> None:
    aileron, elevator, other = (excited(90, seed=seed + k) for k in range(3))
    rate = 2.2 * aileron + noise * np.random.default_rng(seed).normal(size=aileron.size)
    demand = {1: aileron, 2: elevator, 3: 0.3 * other, 5: 0.8 * aileron}
    assert trial(demand, rate, 1) == trial(demand, rate, 5) == trial(demand, rate, 1, 5) == ""
    assert str(trial(demand, rate, 2)).startswith("servo 2 does not move roll, servos 1 and 5 do: ")
    assert str(trial(demand, rate, 1, 2)).startswith("servo 2 does not move roll, servo 1 does")
    assert str(trial(demand, rate, 2, 3)).startswith("servos 2 and 3 do not move roll, servos 1 and 5 do")
    assert trial({2: elevator, 3: other}, rate, 2) is None, "no output moves it: a surface may be lost"
    still = aileron.copy()
    still[len(still) // 2 :] = 0.1  # overridden: its surface failed, and the profile is right
    assert trial({**demand, 5: still}, rate, 1, 5) == ""


@needs(REAL_LOGS / "sitl" / "control")
@pytest.mark.parametrize("name", ["h02_light_mixed.tlog", "h20_wind6.tlog"])
def test_healthy_flights_by_another_aircrafts_profile(run: Run, name: str) -> None:
    outcome = run("analyse", REAL_LOGS / "sitl" / "control" / name, "--airframe", "paper", "--json")
    assert outcome.code == ExitCode.UNDECIDED
    verdicts = {v["actuator"]: v for v in json.loads(outcome.out)["verdicts"]}
    assert {v["worst"] for v in verdicts.values()} <= NO_ALARM
    assert verdicts["roll"]["condition"] == "normal", "the log holds the take-off"
    assert WRONG in verdicts["aileron_right"]["reason"]


@needs(REAL_LOGS / "alfa")
def test_a_flight_without_parameters_by_another_aircrafts_profile() -> None:
    log = REAL_LOGS / "alfa" / "2018-07-18-15-53-31_1_engine_failure.tlog"
    verdicts = {v.actuator: v for v in mavhums.analyse(log, mavhums.Options(airframe="paper")).verdicts}
    said = "servos 1 and 2 do not move roll, servos 4, 5 and 6 do: the profile may name the wrong output"
    assert verdicts["roll"].reason == said


def refuted(answer: np.ndarray, output: np.ndarray, sent: dict[int, np.ndarray], *servos: int) -> str:
    """What refutes an alarm of the roll whose ailerons are these servos; it is lost at 120 s."""
    flight = steady(len(answer) // 20)
    flight["roll_rate"] = 2.2 * answer + 0.02 * np.random.default_rng(2).normal(size=len(answer))
    flight["outputs"][:, 0] = output
    pulses = np.full((len(answer), ALL_OUTPUTS), np.nan)
    for servo, share in sent.items():
        pulses[:, servo - 1] = 1500 + 400 * share
    ailerons = tuple(SurfaceOutput(servo, "aileron", 1500, 400) for servo in servos)
    return refutation(rows(flight), pulses, "roll", ailerons, AxisLimits())


def test_an_aileron_whose_output_stops_with_it_is_no_wrong_output() -> None:
    """The other aileron alone answers as before, and the stopped one shows nothing: the alarm remains."""
    demand = excited(180)
    lost = np.arange(len(demand)) >= 120 * 20
    both = np.where(lost, 2.0, 1.0) * demand
    assert refuted(demand, both, {1: np.where(lost, 0.0, demand), 2: demand}, 1, 2) == ""
    other = 0.1 * np.random.default_rng(9).normal(size=len(demand))
    said = refuted(demand, both, {1: other, 2: demand}, 1, 2)
    assert said.startswith("servo 1 does not move roll, servo 2 does")


@pytest.mark.parametrize("loose", [0.25, 0.4])
def test_a_rudder_that_moves_with_the_ailerons_does_not_refute_their_loss(loose: float) -> None:
    """It hides some of the loss, so that it raises no alarm yet: no proof that it moves the aircraft."""
    demand, other = excited(135), excited(135, seed=8)
    answer = np.where(np.arange(len(demand)) >= 120 * 20, 0.5, 1.0) * demand
    assert refuted(answer, demand, {6: demand, 4: demand + loose * other}, 6) == ""


@needs(REAL_LOGS / "alfa")
def test_names_lose_no_alarm_of_a_real_flight() -> None:
    log = REAL_LOGS / "alfa" / "2018-10-05-14-37-22_3_left_aileron_failure.tlog"
    verdicts, _, _ = by_profile(log.read_bytes(), load_airframe(ALFA))
    assert verdicts["roll"].worst in ("degraded", "emergency")
