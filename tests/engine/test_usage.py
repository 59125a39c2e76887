"""What is told of outputs, motors and networks beside the verdicts: names, ranges and numbers, by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mavhums.actuator import load_airframe
from mavhums.engine.actuators import network_answer
from mavhums.engine.axes import with_drops
from mavhums.engine.motors import VehicleMotors, beside_motors
from mavhums.engine.usage import _facts_by_servo, _motors, _output, _OutputFacts, at_full_output
from mavhums.health.decision.events import ConditionChanged
from mavhums.health.verdict.obstacles import NO_WINGS, PROPELLERS_ONLY, Obstacle
from mavhums.log.base.decoder import Losses
from mavhums.results.sections import WindowsOfClass
from mavhums.vehicle.facts import OUTPUTS
from mavhums.vehicle.grid import Received, Seconds
from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.phases import Phases
from mavhums.vehicle.rotors import Rotors
from mavhums.vehicle.surfaces import STEERING, SurfaceOutput, Surfaces
from mavhums.vehicle.usage import OutputUse
from tests.flights import START, verdict
from tests.vehicle.test_phases import MOTOR, seconds


def rotors(*servos: int, lift: bool = False) -> Rotors:
    bearings = tuple(90.0 * k for k in range(len(servos)))
    return Rotors("quad X", servos, ((0.0,) * 3,) * len(servos), bearings, 1000.4, 1999.6, None, lift)


def use(**held_s: float) -> OutputUse:
    """An output from 1100 to 1900 µs that holds pulses for so many seconds: ``at_1500=2.0``."""
    held = np.zeros(1401, dtype=np.int64)
    for name, time_s in held_s.items():
        held[int(name.removeprefix("at_")) - 800] = round(time_s * 1e6)
    return OutputUse(1100, 1900, 2000, 7, held)


def test_an_output_is_told_by_its_range() -> None:
    found = _output(
        4, use(at_1000=1.0, at_1500=2.0, at_2000=5.0), _OutputFacts("flap", "profile", (1000, 1500, 2000))
    )
    assert found.model_dump(exclude_unset=True) == {
        "servo": 4,
        "name": "flap",
        "named_by": "profile",
        "commanded": True,
        "range_us": (1000, 1500, 2000),
        "least_us": 1100,
        "greatest_us": 1900,
        "span": 0.8,
        "travelled_us": 2000,
        "travelled": 2.0,
        "reversals": 7,
        "held_s": 8.0,
        "at_low_s": 1.0,
        "at_high_s": 5.0,
        "mean_us": 1750.0,
        "bearing_deg": None,
    }


def test_figures_of_an_output_are_rounded_to_what_a_log_can_tell() -> None:
    """1234 µs and 300 µs of a range of 700; 1.2344 s at 1000 µs and 0.3333 s at 1500 µs."""
    held = use(at_1000=1.2344, at_1500=0.3333)._replace(greatest_us=1400, travelled_us=1234)
    found = _output(4, held, _OutputFacts("flap", "profile", (1000, 1400, 1700)))
    assert (found.span, found.travelled, found.mean_us) == (0.4286, 1.763, 1106.3)
    assert (found.held_s, found.at_low_s, found.at_high_s) == (1.568, 1.234, 0.0)


def test_an_output_without_a_range_or_without_use_has_what_is_known() -> None:
    silent = _output(4, None, _OutputFacts("motor 1", "parameters", (1000, 1000, 2000), 45.0))
    assert (silent.commanded, silent.travelled_us, silent.reversals, silent.held_s) == (False, 0, 0, 0.0)
    assert (silent.range_us, silent.bearing_deg) == ((1000, 1000, 2000), 45.0)
    assert {silent.span, silent.travelled, silent.at_low_s, silent.at_high_s, silent.mean_us} == {None}
    nameless = _output(4, use(at_1500=1.0), None)
    assert (nameless.name, nameless.named_by, nameless.range_us, nameless.bearing_deg) == (None,) * 4
    assert (nameless.span, nameless.travelled, nameless.at_low_s, nameless.travelled_us) == (
        None,
        None,
        None,
        2000,
    )


def test_motors_are_named_by_their_outputs_where_those_are_recorded() -> None:
    found = dict(_motors(rotors(3, OUTPUTS, OUTPUTS + 1)))
    assert found == {
        3: _OutputFacts("motor 1", "parameters", (1000, 1000, 2000), 0.0),
        OUTPUTS: _OutputFacts("motor 2", "parameters", (1000, 1000, 2000), 90.0),
    }
    assert [*_motors(rotors(1, lift=True))] == [*_motors("why")] == [*_motors(None)] == []


def test_a_profile_names_an_output_unless_the_parameters_contradict_it() -> None:
    paper = load_airframe("paper")
    elevator = next(one for one in paper.actuators if one.name == "elevator")
    none, aileron = Parameters(1, False, {}), Parameters(1, False, {f"SERVO{elevator.servo}_FUNCTION": 4.0})
    assert dict(_facts_by_servo(none, paper, None))[elevator.servo].by == "profile"
    assert dict(_facts_by_servo(aileron, paper, None))[elevator.servo].by == "parameters"
    assert dict(_facts_by_servo(aileron, None, None))[elevator.servo].name == "aileron"
    ends = {f"SERVO{n}_FUNCTION": 19.0 for n in (1, OUTPUTS, OUTPUTS + 1)}
    assert [servo for servo, _ in _facts_by_servo(Parameters(1, False, ends), None, None)] == [1, OUTPUTS]
    at_end = [elevator.model_copy(update={"servo": servo}) for servo in (OUTPUTS, OUTPUTS + 1)]
    moved_there = paper.model_copy(update={"actuators": tuple(at_end)})
    assert [servo for servo, _ in _facts_by_servo(none, moved_there, None)] == [OUTPUTS]
    moved = SurfaceOutput(2, "aileron", 1500, 400)
    assert [facts.by for _, facts in _facts_by_servo(none, None, Surfaces((moved,), "inferred"))] == [
        "inferred"
    ]
    assert [*_facts_by_servo(none, None, Surfaces((moved,), "profile"))] == []
    steering = Surfaces((SurfaceOutput(1, STEERING, 1500, 400),), "parameters")
    [(servo, facts)] = _facts_by_servo(none, None, steering)
    assert (servo, facts.name, facts.by) == (1, STEERING, "parameters")


def test_motors_at_full_output_for_a_second_leave_no_thrust() -> None:
    """Motor 3 has no use, motor 2 was full for less than a second, and of the rest the sum counts."""
    outputs = {1: use(at_1995=0.6, at_2000=0.4), 2: use(at_2000=0.9), 4: use(at_2000=3.4, at_1000=9.0)}

    def said(judged: Rotors | None) -> list[str]:
        followed: Any = SimpleNamespace(
            motors=SimpleNamespace(rotors=judged), usage=SimpleNamespace(outputs=outputs)
        )
        return [*at_full_output(followed)]

    assert said(rotors(1, 2, 3, 4)) == ["at full output in all: motor 1 for 1 s, motor 4 for 3 s"]
    assert said(rotors(2)) == said(rotors(1, lift=True)) == said(None) == []


def test_motors_are_kept_for_the_first_twenty_seconds_until_parameters_come(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fed: list[list[int]] = []

    class Monitor:
        def __init__(self, vehicle: int, judged: Rotors, speeds: object) -> None:
            self.rotors = judged

        def feed(self, seconds: Seconds, phases: object) -> list[Any]:
            fed.append(seconds.index.tolist())
            return []

    def feed(first: int, last: int) -> list[ConditionChanged]:
        part = replace(seconds(altitude=np.zeros(last - first)), index=np.arange(first, last))
        return [*several.feed(part, phases.feed(part))]

    monkeypatch.setattr("mavhums.health.motor.monitor.MotorMonitor", Monitor)
    several, phases, forgotten = VehicleMotors(1), Phases(), []
    monkeypatch.setattr(several.speeds, "forget", lambda *given: forgotten.append(given))
    for first, last in ((100, 110), (110, 130), (130, 140)):
        assert feed(first, last) == []
    assert (several.rotors, fed) == (None, [])
    assert forgotten == [(2 * (last - 60), np.inf) for last in (109, 129, 139)]
    several.by_parameters = MOTOR
    assert feed(140, 142) == []
    assert fed == [[*range(100, 110)], [*range(110, 120)], [140, 141]]
    several.by_parameters = None
    assert several.rotors is not None, "a motor that loses its output in flight is still the aircraft's"


NO_TELEMETRY = Obstacle("it reports no attitude", "record it")
WINGLESS = Obstacle("quadrotor: only fixed wings have axes", NO_WINGS)


@pytest.mark.parametrize(
    ("by_parameters", "multirotor", "why", "on_ground", "told"),
    [
        (rotors(1), True, WINGLESS, False, ["motors"]),
        (None, True, WINGLESS, False, ["motors"]),
        (None, False, WINGLESS, False, ["axes"]),
        (None, True, NO_TELEMETRY, False, ["axes"]),
        (None, False, NO_TELEMETRY, True, [STEERING]),
        (None, False, None, False, []),
        (None, True, None, False, []),
        (rotors(1, lift=True), False, None, False, ["motors"]),
        (rotors(1, lift=True), False, NO_TELEMETRY, False, ["axes", "motors"]),
    ],
)
def test_which_verdicts_a_vehicle_with_motors_has(
    by_parameters: Rotors | None,
    multirotor: bool,
    why: Obstacle | None,
    on_ground: bool,
    told: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ours = "mavhums.health.verdict.motor.verdicts_of_motors"
    monkeypatch.setattr(ours, lambda *_: iter([verdict(actuator="motors")]))
    several = VehicleMotors(1)
    several.by_parameters = by_parameters
    identity: Any = SimpleNamespace(vehicle=1, multirotor=multirotor)
    flight: Any = SimpleNamespace(on_ground=on_ground)
    found = [*several.verdicts(identity, flight, why, START, {})]
    assert [one.actuator for one in found] == told
    if told and told[0] != "motors" and why is not None:
        assert (found[0].reason, found[0].remedy) == why


def test_beside_motors_no_verdict_says_that_a_copter_has_no_surfaces() -> None:
    wingless = verdict().model_copy(update={"remedy": PROPELLERS_ONLY})
    motor = verdict(actuator="motor 1").model_copy(update={"subject": "motor"})
    assert [*beside_motors([wingless, verdict()], [verdict(), motor])] == [verdict()]
    assert [*beside_motors([wingless, verdict()], [verdict()])] == [wingless, verdict()]


@pytest.mark.parametrize(
    ("by_network", "decide", "decides"),
    [
        (True, "physics", "network"),
        (False, "physics", "physics"),
        (False, "network", "physics"),
        (False, "both", "both"),
        (True, "both", "network"),
    ],
)
def test_the_answer_of_a_network_says_who_decides(by_network: bool, decide: Any, decides: str) -> None:
    said = SimpleNamespace(
        network=1,
        windows=9,
        classes={"normal": (9, 0.98766)},
        says="normal",
        latest=SimpleNamespace(said="normal", probability=0.98766),
        first_emergency_s=1.23456,
        share_of_samples=0.123456,
        condition="normal",
    )
    findings: Any = SimpleNamespace(network=said, by_network=by_network)
    serving: Any = [
        None,
        SimpleNamespace(
            card=SimpleNamespace(name="small"), hash="0" * 64, keys=("V3", "V5"), window_quantities=("V7",)
        ),
    ]
    answer = network_answer(findings, serving, decide)
    assert answer is not None
    assert (answer.decides, answer.model.name, answer.inputs, answer.windows) == (
        decides,
        "small",
        {"samples": ("V3", "V5"), "windows": ("V7",)},
        9,
    )
    assert (answer.first_emergency_s, answer.share_of_samples, answer.probability) == (1.235, 0.1235, 0.9877)
    assert answer.classes == {"normal": WindowsOfClass(windows=9, probability=0.9877)}
    said.first_emergency_s = None
    without = network_answer(findings, serving, decide)
    assert without is not None
    assert without.first_emergency_s is None
    findings.network = None
    assert network_answer(findings, serving, decide) is None


def test_losses_are_summed_over_vehicles_by_message() -> None:
    received = {1: {"A": Received(9, 1, 2), "B": Received(9, 0, 0)}, 2: {"A": Received(9, 3, 4)}}
    axes: Any = SimpleNamespace(vehicles=lambda: (1, 2), received=received.__getitem__)
    clocks: Any = SimpleNamespace(
        copies={(1, "A"): 5, (2, "A"): 6, (1, "C"): 0}, broken={(1, "B"): 7, (2, "B"): 1}
    )
    found = with_drops(Losses(), clocks, axes)
    assert (found.late_samples, found.same_time_samples) == ({"A": 4}, {"A": 6})
    assert (found.copies, found.broken_stamps) == ({"A": 11}, {"B": 8})
