"""The servo bridge: what the script calls, what that is on the wire, and what mavhums makes of the log."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega

from benchmarks import bridge as cost
from mavhums import Options, actuators, analyse, load_airframe, read_log
from mavhums_sim import Flight, FlightRecord, fly
from tests.bridge.autopilot import SCRIPT, Autopilot, Sent, Telemetry, frame
from tests.conftest import Run

PROFILE = SCRIPT.with_suffix(".toml")
README = SCRIPT.with_name("README.md")
SERVOS = {0: "aileron_left", 1: "elevator", 3: "rudder", 4: "aileron_right"}
START_US = 1_767_258_000_000_000
GEAR_RATIO = 300.0
UNLIMITED = {"HUMS_LINK": 1e6}


def steady(*indexes: int, every_ms: int = 5) -> Autopilot:
    """Servos that report the same of everything, every few milliseconds."""

    def report(now_ms: int) -> dict[int, Telemetry]:
        updated = now_ms // every_ms * every_ms
        return {k: Telemetry(updated, 1.0, 2.0, 27.0, 0.25, 12.0, 3150) for k in indexes}

    return Autopilot(report)


def write_tlog(path: Path, sent: list[Sent], link: ardupilotmega.MAVLink) -> None:
    """Write what a ground station records: the named values among heartbeats and attitudes."""
    with path.open("wb") as file:

        def record(time_ms: int, packed: bytes) -> None:
            file.write(struct.pack(">Q", START_US + 1000 * time_ms) + packed)

        beat = ardupilotmega.MAVLink_heartbeat_message(1, 3, 81, 10, 4, 3)
        due_ms = 0
        for one in sent:
            if one.time_ms >= due_ms:
                record(one.time_ms, bytes(beat.pack(link)))
                record(one.time_ms, bytes(level(one.time_ms).pack(link)))
                due_ms = one.time_ms + 1000
            record(one.time_ms, frame(link, one))


def level(time_ms: int) -> ardupilotmega.MAVLink_attitude_message:
    return ardupilotmega.MAVLink_attitude_message(time_ms, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def flown(flight: FlightRecord, **parameters: float) -> Autopilot:
    """Run the bridge during a simulated flight whose servos report at 100 Hz."""

    def report(now_ms: int) -> dict[int, Telemetry]:
        return {index: telemetry(flight, surface, now_ms) for index, surface in SERVOS.items()}

    autopilot = Autopilot(report, {"HUMS_LINK": 1e6, **parameters})
    autopilot.run(flight.flight.duration_s)
    return autopilot


def telemetry(flight: FlightRecord, surface: str, now_ms: int) -> Telemetry:
    record = flight.actuators[surface]
    row = max(0, int(np.searchsorted(record.time_s, (now_ms - 5000) / 1000, side="right")) - 1)
    values = record.values[row]
    command, position, voltage, current, speed = (float(values[k - 1]) for k in (1, 3, 4, 5, 10))
    updated_ms = 5000 + round(1000 * float(record.time_s[row]))
    return Telemetry(updated_ms, command, position, voltage, current, 6 * speed, 3000)


@pytest.fixture(scope="module")
def growing() -> FlightRecord:
    return fly(Flight(seed=3, duration_s=60.0, friction_nm={"elevator": (0.225, 1.3)}))


@pytest.fixture(scope="module")
def growing_log(growing: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bridge") / "bridge.tlog"
    write_tlog(path, flown(growing, HUMS_RATE=50).sent, ardupilotmega.MAVLink(None, 1, 1))
    return path


def test_every_quantity_of_every_servo_is_sent_under_its_number() -> None:
    autopilot = steady(0, 9)
    autopilot.parameters = dict(UNLIMITED)
    autopilot.run(2.0)
    values = {one.name: one.value for one in autopilot.sent}
    names = ("Cmd", "Pos", "V", "A", "Spd", "T")
    assert values == {
        f"S{n}{name}": value
        for n in (1, 10)
        for name, value in zip(names, (1.0, 2.0, 27.0, 0.25, 12.0, 31.5), strict=True)
    }


@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 25.0])
def test_each_servo_keeps_the_rate_and_temperature_comes_once_a_second(rate_hz: float) -> None:
    autopilot = steady(0, 1, 2, 3)
    autopilot.parameters = {**UNLIMITED, "HUMS_RATE": rate_hz}
    autopilot.run(10.0)
    for n in range(1, 5):
        assert len([one for one in autopilot.sent if one.name == f"S{n}Pos"]) == pytest.approx(
            10 * rate_hz, abs=2
        )
        assert len([one for one in autopilot.sent if one.name == f"S{n}T"]) == pytest.approx(10, abs=1)


def test_the_servos_take_turns_so_that_no_burst_fills_the_port() -> None:
    autopilot = steady(0, 1, 2, 3)
    autopilot.parameters = {**UNLIMITED, "HUMS_RATE": 25}
    autopilot.run(3.0)
    at_once: dict[int, set[str]] = {}
    for one in autopilot.sent:
        at_once.setdefault(one.time_ms, set()).add(one.name[:2])
    assert {len(servos) for servos in at_once.values()} == {1}


@pytest.mark.parametrize("servos", [1, 4, 12])
def test_the_link_never_gets_more_than_its_limit(servos: int) -> None:
    autopilot = steady(*range(servos))
    autopilot.parameters = {"HUMS_RATE": 50, "HUMS_LINK": 1500}
    autopilot.run(12.0)
    for start_ms in range(5000, 16000, 500):
        assert autopilot.bytes_per_second(start_ms, start_ms + 1000) <= 1500 + 150 + 150
    assert autopilot.bytes_per_second(6000, 16000) == pytest.approx(1500, rel=0.03)


def test_too_slow_a_link_is_reported_with_the_remedy() -> None:
    autopilot = steady(*range(8))
    autopilot.run(12.0)
    assert autopilot.texts[-2:] == [
        (6, "HUMS: 8 servos, 2.4 Hz, 2514 B/s"),
        (4, "HUMS: wear needs 20 Hz: raise HUMS_LINK"),
    ]
    assert max(len(text) for _, text in autopilot.texts) <= 50


def test_the_reached_rate_is_reported_once_and_again_when_a_parameter_changes() -> None:
    def report(now_ms: int) -> dict[int, Telemetry]:
        autopilot.parameters["HUMS_RATE"] = 25.0 if now_ms > 40_000 else 10.0
        return {k: Telemetry(now_ms, position=1.0) for k in (0, 1)}

    autopilot = Autopilot(report)
    autopilot.run(80.0)
    loaded, slow, remedy, fast = [text for _, text in autopilot.texts]
    assert loaded == "HUMS: servo bridge loaded"
    assert re.match(r"HUMS: 2 servos, 10\.[01] Hz, ", slow)
    assert remedy == "HUMS: wear needs 20 Hz: raise HUMS_RATE"
    assert re.match(r"HUMS: 2 servos, 25\.[01] Hz, ", fast)


def test_slow_servos_differ_from_a_slow_link() -> None:
    autopilot = steady(0, every_ms=100)
    autopilot.parameters = {"HUMS_RATE": 25.0}
    autopilot.run(15.0)
    assert autopilot.texts[-1] == (4, "HUMS: wear needs 20 Hz: servos report slower")


@pytest.mark.parametrize("rate_hz", [10.0, 25.0])
def test_turns_that_a_late_scheduler_missed_are_caught_up(rate_hz: float) -> None:
    late = steady(*range(6))
    late.late_ms, late.parameters = 9, {**UNLIMITED, "HUMS_RATE": rate_hz}
    late.run(10.0)
    assert len([one for one in late.sent if one.name == "S4Pos"]) == pytest.approx(10 * rate_hz, rel=0.04)


def test_old_telemetry_is_not_sent_again() -> None:
    """A servo that reports at 2 Hz is sent at 2 Hz, and one that falls silent is not sent."""
    slow = steady(0, every_ms=500)
    slow.parameters = dict(UNLIMITED)
    slow.run(10.0)
    assert len([one for one in slow.sent if one.name == "S1Pos"]) == pytest.approx(20, abs=1)
    silent = Autopilot(lambda now_ms: {0: Telemetry(min(now_ms, 8000), position=1.0)}, dict(UNLIMITED))
    silent.run(20.0)
    assert max(one.time_ms for one in silent.sent) <= 8000 + 100


def test_a_servo_that_appears_later_is_found() -> None:
    late = Autopilot(
        lambda now_ms: {0: Telemetry(now_ms, position=1.0)} if now_ms > 8000 else {}, dict(UNLIMITED)
    )
    late.run(8.0)
    assert 8000 < late.sent[0].time_ms <= 9100


def test_what_a_servo_does_not_report_is_not_sent() -> None:
    partial = Autopilot(
        lambda now_ms: {2: Telemetry(now_ms, position=float("nan"), voltage=26.0)}, dict(UNLIMITED)
    )
    partial.run(2.0)
    assert {one.name for one in partial.sent} == {"S3V"}


@pytest.mark.parametrize(
    ("parameters", "names"),
    [
        ({"HUMS_MASK": 0b1000}, {"S4Pos", "S4A"}),
        ({"HUMS_FIRST": 0}, {"S1Pos", "S3Pos", "S1A", "S3A"}),
        ({"HUMS_SEND": 8}, {"S1A", "S2A", "S4A"}),
        ({"HUMS_ENABLE": 0}, set()),
    ],
    ids=["servo 4 alone", "DroneCAN numbers", "current alone", "disabled"],
)
def test_parameters_choose_what_is_sent(parameters: dict[str, float], names: set[str]) -> None:
    autopilot = Autopilot(
        lambda now_ms: {k: Telemetry(now_ms, position=1.0, current=0.1) for k in (0, 1, 3)},
        {**UNLIMITED, **parameters},
    )
    autopilot.run(2.0)
    assert {one.name for one in autopilot.sent} == names


def test_older_firmware_is_refused_in_one_line() -> None:
    old = Autopilot(lambda _: {}, firmware=(4, 6))
    old.run(5.0)
    assert [(severity, "4.7" in text) for severity, text in old.texts] == [(4, True)]
    assert max(len(text) for _, text in old.texts) <= 100


@pytest.mark.slow
def test_mavhums_reads_the_quantities_that_the_servos_had(growing: FlightRecord, growing_log: Path) -> None:
    histories = actuators(read_log(growing_log), load_airframe(PROFILE))
    assert set(histories) == set(SERVOS.values())
    for surface, history in histories.items():
        table = history.frame
        truth = growing.actuators[surface]
        start = table.index[0]
        time_s = (table.index - start).total_seconds().to_numpy()
        for key in ("V1", "V3", "V4", "V5", "V10"):
            flown_then = np.interp(time_s, truth.time_s, truth.values[:, int(key[1:]) - 1])
            agreement = np.corrcoef(table[key].to_numpy(), flown_then)[0, 1]
            assert agreement > 0.97, (surface, key)
        for key, name in (("V1", "Cmd"), ("V3", "Pos"), ("V4", "V"), ("V5", "A"), ("V10", "Spd")):
            number = next(index + 1 for index, one in SERVOS.items() if one == surface)
            assert f"S{number}{name}" in history.provenance[key]


@pytest.mark.slow
def test_with_data_sheet_and_limits_the_wear_is_found(growing_log: Path, tmp_path: Path) -> None:
    profile = tmp_path / "mine.toml"
    profile.write_text(with_data_sheet(PROFILE.read_text(encoding="utf-8")), encoding="utf-8")
    assessment = analyse(growing_log, Options(airframe=profile))
    conditions = {verdict.actuator: verdict.condition for verdict in assessment.verdicts}
    assert conditions.pop("elevator") == "emergency"
    assert set(conditions.values()) == {"normal"}


def with_data_sheet(text: str) -> str:
    """Fill in what the profile leaves open: the rotor's speed, the paper's EMA and its limits."""
    head, *blocks = text.split("[[actuators]]\n")
    filled = []
    for block in blocks:
        number = block.split("servo = ")[1].split()[0]
        filled.append(
            f"{block}\n[actuators.fields.V7]\nmessage = 'NAMED_VALUE_FLOAT'\n"
            f"where = {{ name = 'S{number}Spd' }}\nfield = 'value'\nscale = {GEAR_RATIO / 6}\n"
            f"[actuators.ema]\ngear_ratio = {GEAR_RATIO}\ntorque_constant = 0.01460784\n"
            "resistance = 22.6457\ninertia = 2.4e-7\nviscous = 0.025\nviscous_uncertainty = 0.03\n"
            "torque_uncertainty = 0.06\n"
            "[actuators.limits]\nnormal = 0.375\nemergency = 0.875\n"
        )
    return head + "".join(f"[[actuators]]\n{block}\n" for block in filled)


def test_the_profile_alone_shows_the_quantities_and_judges_nothing_as_normal(
    growing_log: Path, run: Run
) -> None:
    outcome = run("analyse", growing_log, "--airframe", PROFILE)
    assert outcome.code in (10, 11, 12), outcome.err
    assert "elevator" in outcome.out


@pytest.mark.slow
def test_the_page_states_the_cost_that_the_benchmark_prints(capsys: pytest.CaptureFixture[str]) -> None:
    cost.main()
    assert capsys.readouterr().out.strip() in README.read_text(encoding="utf-8")
