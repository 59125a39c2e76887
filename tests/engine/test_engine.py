"""The engine's laws: block independence, honest silence, and the right verdicts end to end."""

from __future__ import annotations

import dataclasses
import math
import struct
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2

import mavhums
from mavhums.actuator.mapping import AirframeNamed, Samples
from mavhums.actuator.profile import load_airframe
from mavhums.core.errors import ExitCode
from mavhums.engine.engine import Engine
from mavhums.engine.events import Notice, StandaloneAssessment
from mavhums.engine.options import EngineOptions
from mavhums.flights.compare import compared
from mavhums.health.decision.baseline import Baseline
from mavhums.health.decision.events import ConditionChanged, Window
from mavhums.learn import Model, default_model, packaged_models
from mavhums.results.assessment import Assessment, json_schema
from mavhums.results.reasons import Reason
from mavhums.results.verdict import Verdict
from mavhums_sim import Flight, FlightRecord, fly, write_tlog
from mavhums_sim.conditions import Condition
from mavhums_sim.telemetry import messages
from tests.conftest import REAL_LOGS, SINGLE, needs, real_logs
from tests.judge import judged
from tests.logs import write_log
from tests.present import present
from tests.strategies import START_US, blocks


@pytest.fixture(scope="module")
def model() -> Model:
    return default_model()


def judge(log: bytes, **options: Any) -> Assessment:
    return judged(log, **options)[0]


def judge_records(records: Iterable[tuple[int, bytes]], **options: Any) -> Assessment:
    return judge(b"".join(data for _, data in records), **options)


def of(assessment: Assessment, actuator: str, vehicle: int = 1) -> Verdict:
    return next(v for v in assessment.verdicts if (v.vehicle, v.actuator) == (vehicle, actuator))


def packed(
    record: FlightRecord, system: int = 1, shift_us: int = 0, sent: Callable[[float, Any], Any] | None = None
) -> list[tuple[int, bytes]]:
    """The flight's records as (time, bytes), from a vehicle of another system id.

    ``sent`` returns what is sent of a message at a time, s; None leaves it out.
    """
    link = v2.MAVLink(None, srcSystem=system, srcComponent=1)
    out = []
    for time_s, message in messages(record):
        time_us = START_US + shift_us + round(time_s * 1e6)
        if (own := sent(time_s, message) if sent else message) is not None:
            out.append((time_us, struct.pack(">Q", time_us) + bytes(own.pack(link))))
    return out


def is_array(message: Any) -> bool:
    return bool(message.get_type() == "DEBUG_FLOAT_ARRAY")


def with_values(message: Any, values: Mapping[int, float]) -> Any:
    """Return a message with these of the actuator's quantities, if it has any."""
    if is_array(message):
        message.data = [values.get(k, value) for k, value in enumerate(message.data)]
    return message


@pytest.fixture(scope="module")
def models() -> tuple[Model, ...]:
    return packaged_models()


def test_growing_friction_is_followed_through_both_limits(growing_log: Path, model: Model) -> None:
    assessment, events = judged(blocks(growing_log.read_bytes(), [500_000]), models=(model,))
    elevator = of(assessment, "elevator")
    assert (elevator.condition, elevator.worst) == ("emergency", "emergency")
    friction = [e.rule.split(":")[0] for e in elevator.evidence if e.kind == "friction"]
    assert friction == ["degraded", "emergency"]
    # 0.2 N·m grows by 0.025 N·m each second: 0.375 at 7 s and 0.875 at 27 s. That it is above the first is
    # sure only once the whole interval is; that it may have reached the second, once its upper end has. It is
    # never normal through a window of 10 s.
    degraded, emergency = elevator.evidence
    assert degraded.start_s == pytest.approx(7.0, abs=4.0)
    assert emergency.start_s == pytest.approx(27.0, abs=4.0)
    assert present(elevator.since).flight_time_s == emergency.start_s
    assert elevator.suspects[0].fault == "friction"
    assert elevator.suspects[0].confidence > 0.99
    for other in ("aileron_left", "aileron_right", "rudder"):
        verdict = of(assessment, other)
        assert (verdict.condition, verdict.worst) == ("normal", "normal")
        assert present(verdict.friction_nm).estimate == pytest.approx(0.225, abs=0.01)
    changes = [e.after for e in events if isinstance(e, ConditionChanged) and e.actuator == "elevator"]
    assert changes == ["degraded", "emergency"]
    assert sum(len(e.time_s) for e in events if isinstance(e, Samples)) == 4 * 4000
    windows = [e for e in events if isinstance(e, Window) and e.actuator == "elevator"]
    assert len(windows) == elevator.coverage.windows == 31
    assert [e.airframe.name for e in events if isinstance(e, AirframeNamed)] == ["paper"]


def test_a_model_serves_only_the_airframe_of_its_card(growing_log: Path, model: Model) -> None:
    other = load_airframe("paper").model_copy(update={"name": "other"})
    assessment = judge(growing_log.read_bytes(), airframe=other, models=(model,))
    assert assessment.airframe == "other"
    assert assessment.model is None
    assert of(assessment, "elevator").network is None
    assert of(assessment, "elevator").condition == "emergency"


def test_every_assessment_follows_the_schema(growing_log: Path, model: Model) -> None:
    import json

    validator = jsonschema.Draft202012Validator(json_schema())
    for data in (growing_log.read_bytes(), b"", b"junk"):
        validator.validate(json.loads(judge(data, models=(model,)).to_json()))


def test_without_a_profile_nothing_is_judged(short_log: Path) -> None:
    content = short_log.read_bytes().replace(b"mavhums airframe=paper", b"mavhums airframe=piper")
    drafted = judge(content)
    assert drafted.airframe == "drafted"
    assert {v.condition for v in drafted.verdicts} <= {"learning", "undecided"}
    assessment = judge(content.replace(b"SERVO", b"SIRVO"))  # no parameter is left
    everything = of(assessment, "all")
    assert {v.condition for v in assessment.verdicts} == {"undecided"}
    assert everything.reason_codes == ("no_profile",)
    assert assessment.airframe is None


def test_an_unknown_profile_is_reported() -> None:
    link = v2.MAVLink(None, srcSystem=1, srcComponent=1)
    data = b""
    for hour, text in enumerate((b"mavhums airframe=nonesuch", b"hello")):
        frame = bytes(v2.MAVLink_statustext_message(6, text).pack(link))
        data += struct.pack(">Q", START_US + 3_600_000_000 * hour) + frame
    _, events = judged(data)
    assert [(e.time_s, e.text) for e in events if isinstance(e, Notice)] == [
        (0.0, "names the unknown airframe nonesuch"),
        (3600.0, "hello"),
    ]


def test_a_profile_that_is_given_is_named_for_all_at_the_start_and_once() -> None:
    given = load_airframe("paper")
    engine = Engine(EngineOptions(airframe=given))
    assert engine.feed(b"") == [AirframeNamed(0.0, None, given)]
    assert engine.finish() == []


@pytest.mark.slow
def test_what_the_telemetry_leaves_out_is_named(growing_record: FlightRecord) -> None:
    def commands(_: float, message: Any) -> Any:
        return message if message.get_type() in ("SERVO_OUTPUT_RAW", "STATUSTEXT", "ATTITUDE") else None

    def but_the_rudder(_: float, message: Any) -> Any:
        carried = message.get_type() == "STATUSTEXT" or (is_array(message) and message.array_id != 4)
        return message if carried else None

    assessment = judge_records(packed(growing_record, sent=commands))
    servos = [v for v in assessment.verdicts if v.subject == "actuator"]
    assert {v.condition for v in servos} == {"unmonitored"}
    assert {(v.reason_codes, v.tier) for v in servos} == {(("wear_unseen",), "pwm")}
    assert assessment.exit_code == ExitCode.UNDECIDED
    rudder = of(judge_records(packed(growing_record, sent=but_the_rudder)), "rudder")
    assert rudder.reason_codes == ("left_out",)


@pytest.mark.slow
@pytest.mark.parametrize(("missing", "reason"), [((6,), "V7"), ((3, 4, 7), "V4, V5 or V8")])
def test_an_open_torque_balance_is_named(
    growing_record: FlightRecord, missing: tuple[int, ...], reason: str
) -> None:
    def without(_: float, message: Any) -> Any:
        is_esc = message.get_type().startswith("ESC_")
        return None if is_esc else with_values(message, dict.fromkeys(missing, math.nan))

    verdict = of(judge_records(packed(growing_record, sent=without)), "elevator")
    assert verdict.condition == "undecided"
    assert verdict.reason_codes == ("not_measured",)
    assert str(verdict.reason).startswith(f"{reason} not")


@pytest.mark.slow
def test_two_vehicles_in_one_log_are_kept_apart(growing_record: FlightRecord) -> None:
    healthy = fly(Flight(seed=21, duration_s=40.0))
    assessment = judge_records(sorted(packed(growing_record) + packed(healthy, system=2, shift_us=3_000)))
    assert assessment.log.vehicles == (1, 2)
    assert of(assessment, "elevator", 1).condition == "emergency"
    assert of(assessment, "elevator", 2).condition == "normal"
    alone = judge_records(packed(growing_record))
    assert of(alone, "elevator").evidence == of(assessment, "elevator", 1).evidence


def test_exit_codes_give_the_worst(growing_log: Path, tmp_path: Path) -> None:
    assert judge(growing_log.read_bytes()).exit_code == ExitCode.EMERGENCY
    healthy = tmp_path / "healthy.tlog"
    write_tlog(fly(Flight(seed=5, duration_s=20.0)), healthy)
    content = healthy.read_bytes()
    assert judge(content).exit_code == ExitCode.OK
    assert judge(content + b"\0\0\0").exit_code == ExitCode.OK, "so ends a log that ends with the power"
    assert judge(content[:5000] + b"noise" + content[5000:]).exit_code == ExitCode.READ_WITH_LOSSES
    assert judge(b"").exit_code == ExitCode.UNDECIDED
    degraded = tmp_path / "degraded.tlog"
    write_tlog(fly(Flight(seed=5, duration_s=20.0, friction_nm={"rudder": (0.6, 0.6)})), degraded)
    assessment = judge(degraded.read_bytes())
    assert assessment.exit_code == ExitCode.DEGRADED
    assert "DEGRADED: rudder (servo 4): friction 0." in assessment.summary()
    frame = assessment.to_frame()
    assert frame.set_index("actuator").loc["rudder", "condition"] == "degraded"


REAL = [path for path in real_logs(*SINGLE) if path.suffix == ".tlog"]
JAMMED = "plane_lua_csrv.link1.tlog"
JUDGED = {
    JAMMED: ExitCode.EMERGENCY,
    "ahmadkhanfar-TLOG__test.tlog": ExitCode.OK,
}  # the second: a copter's motors


@needs(REAL_LOGS)
@pytest.mark.parametrize("airframe", [None, "paper"])
@pytest.mark.parametrize("path", REAL, ids=lambda path: path.name)
def test_no_real_log_is_called_normal(path: Path, airframe: str | None, model: Model) -> None:
    assessment = mavhums.analyse(path, mavhums.Options(airframe=airframe, model=model))
    assert assessment.verdicts
    for verdict in assessment.verdicts:
        if verdict.subject == "actuator":
            jam = path.name == JAMMED and verdict.actuator == "aileron_1"  # needs no limit
            assert verdict.condition == verdict.worst in ("undecided", "unmonitored") or jam
        elif path.name != JAMMED and airframe is None:  # another aircraft's profile names the wrong surfaces
            assert verdict.worst in ("undecided", "normal")
        if verdict.condition in ("undecided", "unmonitored") and path.name != JAMMED:
            assert verdict.reason
            assert verdict.remedy
    if airframe is None:
        assert assessment.exit_code == JUDGED.get(path.name, ExitCode.UNDECIDED)


def test_silence_is_never_normal(growing_record: FlightRecord) -> None:
    """The rudder's telemetry ends at 20 s, the elevator's at 35 s, while the flight goes on to 40 s."""

    def heard(time_s: float, message: Any) -> Any:
        ends_s = {4: 20.0, 3: 35.0}.get(message.array_id, 40.0) if is_array(message) else math.inf
        return message if time_s < ends_s else None

    assessment = judge_records(packed(growing_record, sent=heard))
    rudder = of(assessment, "rudder")
    assert (rudder.condition, rudder.worst, rudder.gravest) == ("undecided", "normal", "undecided")
    assert rudder.reason == Reason("silent", last_s=20.0, end_s=40.0, condition="normal").text
    assert rudder.since is None
    elevator = of(assessment, "elevator")
    assert (elevator.condition, elevator.worst) == ("emergency", "emergency")
    assert [v.actuator for v in assessment.ranked()][:2] == ["elevator", "rudder"]


@pytest.mark.slow
def test_a_reboot_in_flight_is_reported_and_survived() -> None:
    """The vehicle's clock starts anew at 30 s; the history goes on."""

    def rebooted(time_s: float, message: Any) -> Any:
        if is_array(message) and time_s > 30.0:
            message.time_usec -= 60_000_000
        return message

    record = fly(Flight(seed=22, duration_s=60.0, friction_nm={"elevator": (1.0, 1.0)}))
    assessment, events = judged(b"".join(data for _, data in packed(record, sent=rebooted)))
    notices = [e.text for e in events if isinstance(e, Notice) and not e.text.startswith("SimBoard")]
    assert notices == ["its clock jumped: it rebooted, or its time was set"]
    elevator = of(assessment, "elevator")
    assert elevator.condition == "emergency"
    assert assessment.log.losses.broken_stamps["DEBUG_FLOAT_ARRAY"] == 2
    assert elevator.coverage.decidable > 45


TIERS = ("instrumented", "esc-signed", "esc-unsigned", "named", "pwm")


@pytest.fixture(scope="module")
def every_tier() -> FlightRecord:
    """Twenty-five seconds in which the elevator is an emergency, reported in every way."""
    flight = Flight(seed=23, duration_s=25.0, rate_hz=25.0, friction_nm={"elevator": (1.0, 1.0)}, tiers=TIERS)
    return fly(flight)


def carrying(record: FlightRecord, *tiers: str) -> FlightRecord:
    return dataclasses.replace(record, flight=dataclasses.replace(record.flight, tiers=tiers))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tiers", "tier", "source"),
    [
        (("instrumented",), "instrumented", "DEBUG_FLOAT_ARRAY[EMA,3].data[4]"),
        (("esc-signed", "pwm"), "esc-signed", "ESC_STATUS[2].current"),
        (("esc-signed",), "esc-signed", "ESC_STATUS[2].current"),
        (("named",), "named", "NAMED_VALUE_FLOAT[S3V05].value"),
        (("esc-unsigned", "pwm"), "esc-unsigned", "derived: magnitude from ESC_TELEMETRY_1_TO_4[2].current"),
        (TIERS, "instrumented", "DEBUG_FLOAT_ARRAY[EMA,3].data[4]"),
    ],
)
def test_every_tier_finds_the_elevator_and_acquits_the_others(
    every_tier: FlightRecord, tiers: tuple[str, ...], tier: str, source: str
) -> None:
    assessment = judge_records(packed(carrying(every_tier, *tiers)))
    elevator = of(assessment, "elevator")
    assert (elevator.condition, elevator.tier) == ("emergency", tier)
    assert elevator.provenance["V5"].startswith(source)
    assert present(elevator.friction_nm).estimate == pytest.approx(1.0, abs=0.08)
    for other in ("aileron_left", "aileron_right", "rudder"):
        assert of(assessment, other).condition == "normal"


@pytest.mark.parametrize("tiers", [("pwm",), ("esc-unsigned",)])
def test_a_tier_that_shows_nothing_says_so(every_tier: FlightRecord, tiers: tuple[str, ...]) -> None:
    """Magnitudes without the command have no sign."""
    assessment = judge_records(packed(carrying(every_tier, *tiers)))
    for verdict in assessment.verdicts:
        assert verdict.condition in ("undecided", "unmonitored")
        assert verdict.reason
        assert verdict.remedy


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tiers", "name"),
    [
        (("instrumented",), "paper-instrumented"),
        (("named",), "paper-instrumented"),
        (("esc-signed", "pwm"), "paper-esc"),
        (("esc-unsigned", "pwm"), "paper-esc"),
        (("pwm",), None),
    ],
)
def test_each_telemetry_gets_the_network_for_what_it_carries(
    every_tier: FlightRecord, models: tuple[Model, ...], tiers: tuple[str, ...], name: str | None
) -> None:
    records = packed(carrying(every_tier, *tiers))
    assessment = judge_records(records, models=models)
    assert (assessment.model and assessment.model.name) == name
    elevator, rudder = of(assessment, "elevator"), of(assessment, "rudder")
    if name is None:
        assert elevator.network is None
    else:
        assert elevator.network is not None
        assert elevator.network.model.name == name
        assert (elevator.network.latest, present(rudder.network).latest) == ("friction_emergency", "normal")
    if name == "paper-esc":
        assert of(judge_records(records, models=models[:1]), "elevator").network is None


def test_without_the_load_torque_the_network_that_does_not_need_it_votes(
    models: tuple[Model, ...],
) -> None:
    """The rudder alone has a load sensor; all have a position sensor."""
    record = fly(Flight(seed=25, duration_s=20.0, friction_nm={"elevator": (1.0, 1.0)}))
    for surface, actuator in record.actuators.items():
        if surface != "rudder":
            actuator.values[:, 10:] = float("nan")
    assessment = judge_records(packed(record), models=models)
    said = {v.actuator: v.network.model.name for v in assessment.verdicts if v.network}
    assert said.pop("rudder") == "paper-instrumented"
    assert set(said.values()) == {"paper-without-load"}
    assert len(said) == 3
    assert present(assessment.model).name == "paper-instrumented"
    elevator = present(of(assessment, "elevator").network)
    assert elevator.latest == "friction_emergency"


def test_an_integrated_angle_of_the_rotor_is_given_to_no_network(models: tuple[Model, ...]) -> None:
    """Beside a measured V3 it drifts, and a healthy elevator had a grave friction by it."""
    record = fly(Flight(seed=24, duration_s=40.0, rate_hz=25.0, cyclogram="gusts"))
    for actuator in record.actuators.values():
        actuator.values[:, [1, 10]] = float("nan")  # V2, V11
    verdicts = judge_records(packed(record), models=models).verdicts
    networks = [one.network for one in verdicts if one.subject == "actuator"]
    assert {(present(one).model.name, present(one).says) for one in networks} == {("paper-esc", "normal")}


def test_without_a_command_no_network_of_windows_takes_it_for_zero(models: tuple[Model, ...]) -> None:
    """ESCs alone: what is flown by degree commanded is no 0, by which healthy actuators had a weak supply."""
    record = fly(Flight(seed=24, duration_s=30.0, rate_hz=25.0, tiers=("esc-signed",)))
    verdicts = judge_records(packed(record), models=models).verdicts
    assert [(one.condition, one.network) for one in verdicts if one.subject == "actuator"] == [
        ("normal", None)
    ] * 4


@pytest.fixture(scope="module")
def at_bus() -> Callable[..., Assessment]:
    """Judge a flight whose ESCs measure at the supply bus."""
    paper = load_airframe("paper")
    sides = tuple(actuator.model_copy(update={"esc_side": "bus"}) for actuator in paper.actuators)
    airframe = paper.model_copy(update={"actuators": sides})

    def judged_at_bus(**flight: Any) -> Assessment:
        flown = Flight(rate_hz=25.0, tiers=("esc-signed", "pwm"), esc_side="bus", **flight)
        return judge_records(packed(fly(flown)), airframe=airframe)

    return judged_at_bus


def test_a_bus_side_esc_is_undecided_with_its_reason(at_bus: Callable[..., Assessment]) -> None:
    elevator = of(at_bus(seed=24, duration_s=15.0), "elevator")
    assert elevator.condition == "undecided"
    assert elevator.reason_codes == ("bus_power",)
    assert "V6" in elevator.provenance
    assert "V5" not in elevator.provenance


def servo_log(
    path: Path, shaft: Callable[[float], float], *, seconds: float = 40.0, rate_hz: float = 10.0
) -> Path:
    """A servo that is commanded ±20° and reports command and angle as NAMED_VALUE_FLOAT; nothing else."""
    sent: list[Any] = [v2.MAVLink_attitude_message(0, *[0.0] * 6)]
    for k in range(round(seconds * rate_hz)):
        command = 20.0 * math.sin(0.9 * k / rate_hz)
        for name, value in ((b"S1Cmd", command), (b"S1Pos", shaft(k / rate_hz))):
            sent.append(v2.MAVLink_named_value_float_message(round(1000 * k / rate_hz), name, value))
    return write_log(path, sent, step_us=round(1e6 / rate_hz / 2))


CSRV = Path(__file__).parents[2] / "examples" / "profiles" / "csrv.toml"


def test_a_servo_of_unknown_constants_that_follows_is_undecided(tmp_path: Path) -> None:
    log = servo_log(tmp_path / "follows.tlog", lambda s: 20.0 * math.sin(0.9 * (s - 0.2)))
    aileron = of(mavhums.analyse(log, mavhums.Options(airframe=CSRV)), "aileron_1")
    assert (aileron.condition, aileron.worst, aileron.evidence) == ("undecided", "undecided", ())
    assert "blanks" in aileron.reason_codes


def test_a_jam_is_found_although_the_servos_constants_are_unknown(tmp_path: Path) -> None:
    """It jams at 20 s: from then on three quarters of a period and more pass at the same angle."""
    log = servo_log(tmp_path / "jams.tlog", lambda s: 20.0 * math.sin(0.9 * (min(s, 20.0) - 0.2)))
    assessment = mavhums.analyse(log, mavhums.Options(airframe=CSRV))
    aileron = of(assessment, "aileron_1")
    assert (aileron.condition, aileron.worst) == ("emergency", "emergency")
    assert [suspect.fault for suspect in aileron.suspects] == ["jam"]
    assert present(aileron.since).flight_time_s == pytest.approx(20.0, abs=4.0)
    assert assessment.exit_code == ExitCode.EMERGENCY
    assert {v.worst for v in assessment.verdicts if v.actuator != "aileron_1"} == {"unmonitored"}


def test_the_supplys_sag_is_seen_by_an_esc_at_the_bus(at_bus: Callable[..., Assessment]) -> None:
    sag = {"elevator": (Condition.constant("supply_sag", 6.0),)}
    assessment = at_bus(seed=25, duration_s=30.0, conditions=sag)
    elevator = of(assessment, "elevator")
    assert (elevator.condition, [s.fault for s in elevator.suspects]) == ("degraded", ["supply_sag"])
    (indicator,) = [i for i in elevator.indicators if i.fault == "supply_sag"]
    assert indicator.value.estimate == pytest.approx(6.0, abs=0.3)
    assert of(assessment, "rudder").worst == "undecided"


@pytest.mark.slow
def test_baselines_reach_the_actuator_that_they_are_of(growing_record: FlightRecord) -> None:
    own = Baseline(mean=0.10, error=0.001, flights=10, between=0.002, spread=0.003)
    baselines = {(1, "rudder", "friction"): own, (2, "aileron_left", "friction"): own}
    engine = Engine()
    engine.feed(b"".join(data for _, data in packed(growing_record)))
    engine.finish()
    alone = StandaloneAssessment(engine.assessment(), engine.profiles())
    assessment = compared(alone, lambda *_: baselines)
    rudder = of(assessment, "rudder")
    assert rudder.condition == "degraded"
    assert "friction_drift" in [e.kind for e in rudder.evidence]
    assert next(i for i in rudder.indicators if i.fault == "friction").baseline is not None
    assert of(assessment, "aileron_left").condition == "normal"
