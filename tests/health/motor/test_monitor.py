"""Motors that lose thrust in simulated flights, through the whole program."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import mavhums
from mavhums.app.inspection import inspect_log
from mavhums.core.arrays import Array
from mavhums.engine.motors import VehicleMotors
from mavhums.engine.options import EngineOptions
from mavhums.health.decision.events import ConditionChanged, Trace
from mavhums.health.motor.monitor import MotorMonitor
from mavhums.results.verdict import Verdict
from mavhums.show.answer import blocks
from mavhums.show.blocks import Finding, Headline
from mavhums.show.headline import headline
from mavhums.show.inspection import inspection_blocks
from mavhums.vehicle.facts import OUTPUTS, Signal
from mavhums.vehicle.grid import Grid, Seconds
from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.phases import Phases
from mavhums.vehicle.rotors import Rotors, rotors_of
from mavhums_sim.multirotor.craft import FRAMES, Event, draw_craft, draw_plan
from mavhums_sim.multirotor.flight import Flown, fly
from mavhums_sim.multirotor.log import (
    FUNCTIONS,
    PARAMETERS,
    Rates,
    pulses,
    sampled,
    write_dataflash,
    write_tlog,
)
from mavhums_sim.perturb import without_parameters
from tests.conftest import REAL_LOGS, Run, needs
from tests.present import present

GROUND_S = 12.0
"""What the log shows before the flight."""


def fly_with(loss: float, frame: str, seed: int, motor: int = 2) -> Flown:
    rng = np.random.default_rng([seed, 1])
    event = Event(fault_s=40.0, motor=motor - 1, loss=loss) if loss else Event()
    return fly(draw_craft(rng, frame), draw_plan(rng, 75.0, event=event), seed)


def log(path: Path, frame: str, loss: float, *, seed: int = 1, hz: float = 25.0, motor: int = 2) -> Path:
    flown = fly_with(loss, frame, seed, motor)
    write_tlog(flown, path, Rates(outputs=hz, attitude=hz, imu=hz), seed)
    return path


def motors(path: Path) -> list[Verdict]:
    assessment = mavhums.analyse(path)
    assert {verdict.subject for verdict in assessment.verdicts} == {"motor"}
    return list(assessment.verdicts)


OTHERS = (("quad +", 0.6), ("hexa x", 5.0), ("octa x", 5.0))


@pytest.mark.parametrize(
    ("frame", "within_s"),
    [("quad x", 0.6), *(pytest.param(*case, marks=pytest.mark.slow) for case in OTHERS)],
)
def test_a_motor_that_stops_is_named(tmp_path: Path, frame: str, within_s: float) -> None:
    [verdict] = motors(log(tmp_path / "f.tlog", frame, 1.0, seed=3))
    assert (verdict.actuator, verdict.condition) == ("motor 2", "emergency")
    assert verdict.since
    assert verdict.since.flight_time_s == pytest.approx(GROUND_S + 40.0, abs=within_s)
    assert verdict.evidence[0].end_s - GROUND_S - 40.0 < within_s
    assert verdict.effectiveness
    assert verdict.effectiveness.estimate < 0.4
    assert "motor 2" in (verdict.advice or "")
    assert next(inspection_blocks(inspect_log(tmp_path / "f.tlog"))) == Headline("Motors can be judged")


@pytest.mark.slow
@pytest.mark.parametrize(("loss", "said"), [(0.0, ["normal"] * 4), (0.5, ["degraded"]), (1.0, ["emergency"])])
def test_the_on_board_log_says_what_the_link_says(tmp_path: Path, loss: float, said: list[str]) -> None:
    flown = fly_with(loss, "quad x", 3)
    write_tlog(flown, tmp_path / "f.tlog", Rates(25.0, 25.0, 25.0), 3)
    write_dataflash(flown, tmp_path / "f.BIN", Rates(25.0, 25.0, 25.0), 3)
    sent, kept = motors(tmp_path / "f.tlog"), motors(tmp_path / "f.BIN")
    assert [(one.actuator, one.condition) for one in sent] == [(one.actuator, one.condition) for one in kept]
    assert [one.condition for one in sent] == said
    for one, other in zip(sent, kept, strict=True):
        shares = one.effectiveness, other.effectiveness
        assert all(shares) == (loss > 0.0)
        if shares[0] and shares[1]:
            assert shares[0].estimate == pytest.approx(shares[1].estimate, abs=0.1)
            assert one.since
            assert other.since
            assert one.since.flight_time_s == pytest.approx(other.since.flight_time_s, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("loss", "by_propeller", "cause"),
    [(0.5, False, "lags"), (0.5, True, "follows"), (1.0, False, "collapsed"), (1.0, True, "follows")],
)
def test_its_escs_speed_names_the_cause(tmp_path: Path, loss: float, by_propeller: bool, cause: str) -> None:
    rng = np.random.default_rng([3, 1])
    event = Event(fault_s=40.0, motor=1, loss=loss, by_propeller=by_propeller)
    flown = fly(draw_craft(rng, "hexa x"), draw_plan(rng, 75.0, event=event), 3)
    write_tlog(flown, tmp_path / "f.tlog", Rates(25.0, 25.0, 25.0, esc=10.0), 3)
    [verdict] = motors(tmp_path / "f.tlog")
    [speed] = [one for one in verdict.evidence if one.kind == "speed"]
    assert cause in speed.rule
    assert ("propeller of motor 2" in (verdict.advice or "")) is by_propeller


def test_a_healthy_flight_reports_what_it_excludes(tmp_path: Path) -> None:
    path = log(tmp_path / "f.tlog", "quad x", 0.0, seed=4)
    found = motors(path)
    assert [verdict.actuator for verdict in found] == [f"motor {n}" for n in range(1, 5)]
    assert {verdict.condition for verdict in found} == {"normal"}
    assert found[0].reason_codes == ("motors_normal",)
    assessment = mavhums.analyse(path)
    assert assessment.exit_code.name in ("OK", "READ_WITH_LOSSES")
    bound = present(found[0].coverage.excluded_loss)
    assert f"no motor lost {100 * bound:.0f} % or more" in (found[0].reason or "")
    assert headline(assessment).text == f"motors 1 to 4: none lost {100 * bound:.0f} % or more of its thrust"
    findings = [block for block in blocks(assessment) if isinstance(block, Finding)]
    assert len(findings) == 1  # said once for all motors, and in short by the headline


def settled(flown: Flown, hz: float, seed: int, mode: float | None = None) -> Seconds:
    """Return what a log records of a flight, on the grid; of an ArduPlane in a mode if one is given."""
    rng = np.random.default_rng([seed, 6])

    def signal(name: str, rate_hz: float, values: Array) -> Signal:
        time_s, rows = sampled(rng, flown, rate_hz)
        time_us = np.rint(time_s * 1e6).astype(np.int64)
        return Signal(1, name, name, time_us, time_us, values[rows])

    outputs = np.full((flown.time_s.size, OUTPUTS), np.nan)
    outputs[:, : flown.command.shape[1]] = pulses(flown.command)
    signals = [
        signal("outputs", hz, outputs),
        signal("rates", max(hz, 10.0), np.round(flown.rates, 3)),
        signal("attitude", hz, flown.attitude),
    ]
    if mode is not None:
        time_us = np.arange(0, int(flown.time_s[-1] * 1e6), 1_000_000)
        state = np.tile([1.0, 3.0, 1.0, mode], (time_us.size, 1))
        signals.append(Signal(1, "state", "state", time_us, time_us, state))
    return present(Grid(0).feed(signals, final=True))


def rotors(frame: str) -> Rotors:
    kind, type_ = FRAMES[frame].parameters
    named = {**PARAMETERS, **FUNCTIONS, "FRAME_CLASS": kind, "FRAME_TYPE": type_}
    known = rotors_of(Parameters(1, False, named))
    assert isinstance(known, Rotors)
    return known


@pytest.mark.parametrize("held", [False, True])
def test_an_obstacle_that_holds_the_craft_is_no_motor(held: bool) -> None:
    """Effort that winds up along the column of motor 2 without a motion is a loss where nothing holds it."""
    quad, rng = rotors("quad x"), np.random.default_rng(1)
    time_s = np.arange(0.0, 90.0, 0.04)
    time_us, late = np.rint(time_s * 1e6).astype(np.int64), time_s[:, None] > 50.0
    wound = np.clip((time_s[:, None] - 50.0) / 4.0, 0.0, 0.6)
    effort = wound * quad.columns[1] + rng.normal(0.0, 0.01, (time_s.size, 3))
    outputs = np.full((time_s.size, OUTPUTS), np.nan)
    outputs[:, :4] = pulses(0.4 * (1.0 + effort @ np.linalg.pinv(quad.columns)))
    attitude = np.where(late, 0.25, 0.0) * np.array([1.0, 0.0, 0.0])
    asked = attitude[:, :2] * (not held)
    sent = {"outputs": outputs, "attitude": attitude, "rates": np.zeros((time_s.size, 3)), "demand": asked}
    signals = [Signal(1, name, name, time_us, time_us, values) for name, values in sent.items()]
    seconds = present(Grid(0).feed(signals, final=True))
    found = [[change.actuator for change in changes_of_quad(seconds, size)] for size in (7, 1000)]
    assert found[0] == found[1] == ([] if held else ["motor 2"])


def changes_of_quad(seconds: Seconds, size: int) -> list[ConditionChanged]:
    """Return what is said of a quad's seconds that come in blocks of a size."""
    return judged(MotorMonitor(1, rotors("quad x")), seconds, size)


def judged(monitor: MotorMonitor, seconds: Seconds, size: int = 1000) -> list[ConditionChanged]:
    """Return what a monitor says of seconds that come in blocks of a size."""
    count, phases = len(seconds.index), Phases()
    parts = (seconds.part(k, min(k + size, count)) for k in range(0, count, size))
    events = (one for part in parts for one in monitor.feed(part, phases.feed(part, monitor.rotors)))
    return [one for one in events if isinstance(one, ConditionChanged)]


@cache
def stopped() -> Flown:
    """Return a flight of a minute whose motor 2 stops at 50 s."""
    rng = np.random.default_rng([8, 1])
    plan = draw_plan(rng, 60.0, event=Event(fault_s=50.0, motor=1, loss=1.0))
    return fly(draw_craft(rng, "quad x"), plan, 8)


def test_the_lift_motors_of_a_quadplane_are_judged_in_a_hover() -> None:
    named = {name.replace("MOT_", "Q_M_"): value for name, value in PARAMETERS.items()}
    named |= {"Q_ENABLE": 1.0, "Q_FRAME_CLASS": 1.0, "Q_FRAME_TYPE": 1.0, "Q_TILT_MASK": 0.0}
    on_four = rotors_of(Parameters(1, False, named | {f"SERVO{k + 1}_FUNCTION": 33.0 + k for k in range(4)}))
    assert isinstance(on_four, Rotors)
    for mode, motors in ((19.0, ["motor 2"]), (10.0, []), (21.0, [])):
        monitor = MotorMonitor(1, on_four)
        found = judged(monitor, settled(stopped(), 25.0, 8, mode))
        assert [change.actuator for change in found] == motors, mode
        assert (monitor.findings().judged_s > 0) is bool(motors)


@pytest.mark.parametrize(("seed", "hz"), [(7000989, 4.0), (7001277, 50.0)])
def test_a_shifted_payload_beside_a_turn_is_no_motor(seed: int, hz: float) -> None:
    """The payload shifts the effort about roll and pitch, and a turn, seconds apart, that about yaw."""
    rng = np.random.default_rng([seed, 1])
    craft = draw_craft(rng, "octa x")
    shift = rng.uniform(-0.15, 0.15, 2)
    event = Event(payload_s=rng.uniform(40, 180), mass=rng.uniform(0.85, 1.25), shift=tuple(shift))
    flown = fly(craft, draw_plan(rng, 240.0, event=event, lands=rng.random() < 0.4), seed)
    monitor = MotorMonitor(1, rotors("octa x"))
    assert judged(monitor, settled(flown, hz, seed)) == []
    assert monitor.findings().loss is None


def test_parameters_that_come_late_find_the_same_seconds_however_blocks_end() -> None:
    seconds = settled(stopped(), 25.0, 8)
    late = 40  # by then only some of the first seconds are kept

    def events(size: int) -> list[ConditionChanged | Trace]:
        motors, phases = VehicleMotors(1, EngineOptions()), Phases()
        found: list[ConditionChanged | Trace] = []
        for first, last in ((0, late), (late, len(seconds.index))):
            for k in range(first, last, size):
                part = seconds.part(k, min(k + size, last))
                found += motors.feed(part, phases.feed(part, motors.rotors))
            motors.by_parameters = rotors("quad x")
        return found

    assert [change.actuator for change in events(1000)] == ["motor 2"]
    assert events(1) == events(7) == events(1000)


def test_without_parameters_it_says_so(tmp_path: Path) -> None:
    path = log(tmp_path / "f.tlog", "quad x", 0.0)
    path.write_bytes(without_parameters(path.read_bytes()))
    [verdict] = motors(path)
    assert (verdict.actuator, verdict.condition) == ("motors", "undecided")
    assert verdict.reason_codes == ("motors_unknown",)


Summary = tuple[float, float, str, str]


def said(change: ConditionChanged) -> Summary:
    """Return when a change is known, since when it is, and between which conditions."""
    return change.time_s, change.since_s, change.before, change.after


def row(row_s: float, motor: int, rows: int, odds: float, share: float = 0.4) -> tuple[float, Array]:
    """Return a row at which a motor shows a loss that began some rows before."""
    return row_s, np.array([motor, rows, odds, share, share - 0.1, share + 0.2, 1.0])


FIRST = row(50.0, 2, 8, 15.0)
FIRST_CHANGE = (50.25, 49.6, "undecided", "degraded")
DOUBTED = "degraded", "emergency"


@pytest.mark.parametrize(
    ("rows", "known", "several", "kept"),
    [
        ([FIRST], [FIRST_CHANGE], (), (49.6, 15.0)),
        ([row(0.25, 2, 8, 15.0)], [(0.5, 0.0, "undecided", "degraded")], (), (0.0, 15.0)),
        # Another motor within ten seconds.
        (
            [FIRST, row(60.0, 4, 16, 19.0), row(61.0, 2, 60, 50.0)],
            [FIRST_CHANGE, (60.25, 49.6, *DOUBTED)],
            (2, 4),
            (49.6, 15.0),
        ),
        ([FIRST, row(60.05, 4, 16, 19.0)], [FIRST_CHANGE], (), (49.6, 15.0)),
        # The same motor again: the share grows for a while.
        ([FIRST, row(50.5, 2, 28, 16.0, 0.45)], [FIRST_CHANGE], (), (49.1, 16.0)),
        ([FIRST, row(50.5, 2, 28, 16.0, 0.35)], [FIRST_CHANGE], (), (49.6, 15.0)),
        ([FIRST, row(52.9, 2, 30, 16.0, 0.45)], [FIRST_CHANGE], (), (49.6, 16.0)),
        ([FIRST, row(53.0, 2, 30, 16.0, 0.45)], [FIRST_CHANGE], (), (49.6, 15.0)),
        (
            [FIRST, row(50.5, 2, 28, 16.0, 0.5), row(51.0, 2, 38, 17.0, 0.9), row(52.0, 2, 58, 18.0, 0.95)],
            [FIRST_CHANGE, (50.75, 49.1, *DOUBTED)],
            (),
            (49.1, 18.0),
        ),
    ],
)
def test_what_follows_an_alarm_refines_it_or_makes_it_doubtful(
    rows: list[tuple[float, Array]], known: list[Summary], several: tuple[int, ...], kept: tuple[float, float]
) -> None:
    monitor = MotorMonitor(1, rotors("quad x"))
    changes = [change for row_s, shown in rows for change in monitor._alarm(row_s, 0.25, shown)]
    assert [said(change) for change in changes] == [pytest.approx(each) for each in known]
    assert {change.actuator for change in changes} == {"motor 2"}
    findings = monitor.findings()
    loss = present(findings.loss)
    assert findings.several == several
    assert (loss.since_s, loss.odds) == pytest.approx(kept)


FLIGHTS = REAL_LOGS.parent / "flights" / "motors"


@needs(FLIGHTS)
@pytest.mark.parametrize(
    ("name", "motor"),
    [
        ("real_q1_motor_lost.BIN", "motor 2"),
        ("rfly1_p00.ulg", "motor 1"),
        ("rfly2_p50.ulg", "motor 1"),
        ("sitl_quadx_m2.BIN", "motor 2"),
        ("sitl_quadp_m4.BIN", "motor 4"),
        ("sitl_hexax_m3.BIN", "motor 3"),
        ("sitl_hexap_m6.BIN", "motor 6"),
        ("real_q2_several_motors.BIN", "motors 1 and 2"),
    ],
)
def test_flights_of_others_name_the_motor(name: str, motor: str) -> None:
    [verdict] = motors(FLIGHTS / name)
    assert (verdict.actuator, verdict.condition) == (motor, "emergency")


PUBLIC = FLIGHTS.parent / "public"


@needs(PUBLIC)
@pytest.mark.parametrize(
    ("name", "condition"),
    [
        ("opencv_drone__00000001.BIN.gz", "undecided"),  # 82 s on the ground
        ("adaptive-IGE-ardupilot__flight-b093a2.tlog.gz", "undecided"),  # a bounce
        ("modular_robots__00000008.BIN.gz", "normal"),  # hits the ground after a minute
        ("drone-control__00000010.BIN.gz", "normal"),  # a hover after a climb
        ("btp__mav-16cac2.tlog.gz", "normal"),  # climbs at full thrust, then a level hover
        ("btp__mav-6d2c2c.tlog.gz", "normal"),
    ],
)
def test_ground_runs_climbs_and_contacts_are_no_faults(name: str, condition: str) -> None:
    found = motors(PUBLIC / name)
    assert {(one.condition, one.worst) for one in found} == {(condition, condition)}
    assert not any(one.evidence for one in found), "no alarm while it flew"
    assert not any("do not fly" in f"{one.reason} {one.remedy}" for one in found)


HEALTHY = [*sorted(path.name for path in FLIGHTS.glob("cut*.BIN")), "real_q3_healthy.BIN"]


@needs(FLIGHTS)
@pytest.mark.parametrize("name", HEALTHY)
def test_real_flights_without_a_loss_in_flight_raise_no_alarm(name: str) -> None:
    assert {verdict.condition for verdict in motors(FLIGHTS / name)} <= {"normal", "undecided"}


@needs(FLIGHTS)
def test_a_cut_propeller_shows_against_flights_with_whole_ones(run: Run, tmp_path: Path) -> None:
    store = ("--store", tmp_path / "store", "--aircraft", "=X500")
    for name in ("cut00_hover1", "cut00_hover2", "cut00_line1"):
        run("analyse", FLIGHTS / f"{name}.BIN", *store, "--keep")
    for name, motor in (("cut25_hover1", "motor 1"), ("cut25_line1", "motor 1"), ("cut10_hover1", "motor 4")):
        found = json.loads(run("analyse", FLIGHTS / f"{name}.BIN", *store, "--json").out)
        worn = [verdict["actuator"] for verdict in found["verdicts"] if verdict["condition"] == "degraded"]
        assert worn == [motor], name
