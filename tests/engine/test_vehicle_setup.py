"""When a vehicle's profile and parameters apply, and what becomes of its axes by them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mavhums.actuator import load_airframe
from mavhums.actuator.contradictions import Contradiction
from mavhums.core.conditions import Condition
from mavhums.engine import motion, vehicle_axes
from mavhums.engine.events import Notice
from mavhums.engine.motion import contradiction, refutation, rests_on_outputs
from mavhums.engine.vehicle_axes import VehicleAxes
from mavhums.engine.vehicle_setup import SetupHistory, VehicleSetup, setup_notices
from mavhums.health.decision.events import ConditionChanged, Indication
from mavhums.vehicle.facts import ALL_OUTPUTS
from mavhums.vehicle.grid import Seconds
from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.surfaces import SurfaceOutput, Surfaces

PAPER = load_airframe("paper")
AILERONS = tuple(SurfaceOutput(servo, "aileron", 1500, 400) for servo in (1, 2))


def parameters(servo: int) -> Parameters:
    """One output that moves an aileron."""
    return Parameters(1, False, {f"SERVO{servo}_FUNCTION": 4.0})


def test_a_fact_applies_ten_seconds_after_it_was_read() -> None:
    history, first = SetupHistory(), parameters(1)
    history.add_parameters(100, first)
    assert [history.at(second).parameters for second in (109, 110)] == [None, first]
    assert [history.next_s(second) for second in (-1, 109, 110)] == [110, 110, None]
    history.add_parameters(105, Parameters(1, False, dict(first.values)))
    assert history.next_s(110) is None, "the same parameters are no other fact"


@pytest.mark.parametrize(("second", "applies_s"), [(101, 110), (107, 110), (108, 118), (500, 510)])
def test_what_comes_while_its_seconds_are_unsettled_applies_with_the_fact_before(
    second: int, applies_s: int
) -> None:
    history, later = SetupHistory(), parameters(2)
    history.add_parameters(100, parameters(1))
    history.add_parameters(second, later)
    assert history.at(applies_s).parameters is later
    assert history.at(applies_s - 1).parameters is not later
    assert (history.next_s(110) is None) == (applies_s == 110)


def test_a_profile_does_not_wait_for_parameters_and_applies_before_what_came_first() -> None:
    history = SetupHistory()
    history.add_parameters(100, parameters(1))
    history.add_profile(50, PAPER)
    assert history.at(59) == VehicleSetup()
    assert (history.at(60).airframe, history.at(60).parameters) == (PAPER, None)
    assert (history.at(110).airframe, history.at(110).parameters) == (PAPER, parameters(1))
    history.add_profile(107, PAPER)
    assert history.next_s(110) == 117


def test_the_oldest_of_many_changes_is_forgotten() -> None:
    history = SetupHistory()
    for k in range(65):
        history.add_parameters(100 * k, parameters(1 + k % 2))
    assert history.at(0).parameters == parameters(1), "the first change counts from the start"
    assert history.next_s(0) == 110
    assert history.at(110).parameters == parameters(2)
    assert history.last.parameters == parameters(1)


def test_an_actuator_is_refused_where_its_output_moves_something_else() -> None:
    history = SetupHistory(PAPER)
    elevator = next(one for one in PAPER.actuators if one.name == "elevator")
    history.add_parameters(20, parameters(elevator.servo))
    times = np.array([0.0, 29.9, 30.0, 99.0])
    assert history.refused("elevator", times).tolist() == [False, False, True, True]
    assert not history.refused("rudder", times).any()


def test_a_notice_says_what_no_verdict_of_an_actuator_does() -> None:
    servo, travel = (Contradiction(1, "rudder", key, f"its {key}") for key in ("servo", "travel_deg"))
    by_log = Surfaces(AILERONS, "profile", by_log=frozenset({"roll"}), contradicted={"roll": "x", "yaw": "y"})
    assert [*setup_notices(VehicleSetup(contradictions=(servo,)), None)] == []
    assert len([*setup_notices(VehicleSetup(contradictions=(servo, travel)), None)]) == 1
    assert [*setup_notices(VehicleSetup(), by_log)] == [
        "roll: judged by the log's parameters, which contradict the profile"
    ]


NOT_1 = "servo 1 does not move roll, servo 3 does: the profile may name the wrong output"
BOTH = "servos 1 and 2 do not move roll, servos 3 and 4 do: the profile may name the wrong output"
LEAST, WORSE = motion._LEAST_SHARE["roll"], motion._WORSE
CLEAR = 0.8


@pytest.mark.parametrize(
    ("shares", "together", "named", "alike", "found"),
    [
        ({}, 0.0, (1,), (), None),
        ({1: LEAST - 0.01}, 1.0, (1,), (), None),
        ({1: LEAST}, 0.0, (1,), (), ""),
        ({1: WORSE * CLEAR, 3: CLEAR}, 0.0, (1,), (), ""),
        ({1: WORSE * CLEAR - 0.01, 3: CLEAR}, 0.0, (1,), (), NOT_1),
        ({1: 0.1, 3: CLEAR}, WORSE * CLEAR, (1,), (), ""),
        ({1: 0.1, 3: CLEAR}, WORSE * CLEAR - 0.01, (1,), (), NOT_1),
        ({3: CLEAR}, 1.0, (1,), (), NOT_1),
        ({3: CLEAR, 4: 0.7}, 0.0, (1, 2), (4,), BOTH),
        ({1: 0.3, 3: CLEAR}, 0.0, (1, 3), (), NOT_1),
        ({1: 0.3, 3: CLEAR}, 0.0, (1, 3), (1,), ""),
        ({1: WORSE * CLEAR, 3: CLEAR}, 0.0, (1, 3), (), ""),
    ],
)
def test_an_output_that_explains_much_less_than_another_does_not_move_the_axis(
    shares: dict[int, float],
    together: float,
    named: Sequence[int],
    alike: Sequence[int],
    found: str | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows: Any = SimpleNamespace(flying=slice(None), demand=lambda _: "together")
    pulses = np.tile(np.arange(4.0), (3, 1))
    monkeypatch.setattr(motion, "_moves", lambda each: int(each[0]) + 1 in shares)
    monkeypatch.setattr(motion, "_alone", lambda pulses, k, outputs: k + 1)
    explained: dict[object, float] = dict(shares.items())
    explained["together"] = together
    monkeypatch.setattr(motion, "_explained", lambda rows, axis, demand: explained[demand])
    monkeypatch.setattr(motion, "_alike", lambda rows, pulses, one, other: one == other or one in alike)
    outputs = [SurfaceOutput(servo, "aileron", 1500, 400) for servo in named]
    assert contradiction(rows, pulses, "roll", outputs) == found


@pytest.mark.parametrize(
    ("alarmed", "whole", "silent", "found"),
    [
        ((), (1, 3), (), ""),
        ((0, 1), (1, 3), (), NOT_1),
        ((0, 1), (1,), (), ""),
        ((0, 1, 3), (1, 3), (), ""),
        ((0,), (1, 3), (), ""),
        ((0, 1), (1, 3), (1,), ""),
        ((0, 1), (1, 3), (3,), ""),
    ],
)
def test_an_alarm_is_refuted_by_an_output_whose_response_is_whole(
    alarmed: Sequence[int],
    whole: Sequence[int],
    silent: Sequence[int],
    found: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Demand 0 is that of all outputs of the profile together; output 2 does not move."""
    n = motion._SHOWN_ROWS + 5
    rows: Any = SimpleNamespace(flying=slice(None), demand=lambda _: np.zeros(n))

    def alone(pulses: Any, k: int, outputs: Any) -> np.ndarray[Any, Any]:
        demand = np.full(n, k + 1.0)
        demand[-motion._SHOWN_ROWS if k + 1 in silent else 0] = np.nan  # the first rows do not count
        return demand

    monkeypatch.setattr(motion, "_moves", lambda each: each[0] in (0, 2))
    monkeypatch.setattr(motion, "_alone", alone)
    monkeypatch.setattr(
        motion,
        "_judged",
        lambda rows, axis, demand, limits: motion._DemandCheck(demand[-1] in whole, demand[-1] in alarmed),
    )
    limits: Any = None
    outputs = [SurfaceOutput(1, "aileron", 1500, 400)]
    assert refutation(rows, np.tile(np.arange(4.0), (n, 1)), "roll", outputs, limits) == found


def changed(
    after: Condition, axis: str = "roll", fault: str = "effectiveness", time_s: float = 9.0
) -> ConditionChanged:
    return ConditionChanged(1, axis, time_s, 5.0, "undecided", after, f"{after}: rule", fault, "roll is lost")


def indication(*end_s: float) -> Indication:
    ends = np.array(end_s)
    return Indication(1, "roll", "effectiveness", ends, ends + 1, ends + 2, ends + 3)


@pytest.mark.parametrize(
    ("event", "expected"),
    [
        (changed("normal"), False),
        (changed("undecided"), False),
        (changed("changed"), True),
        (changed("emergency"), True),
        (changed("emergency", fault="tracking"), False),
        (changed("emergency", fault="trim"), True),
        (indication(1.0), False),
    ],
)
def test_which_events_are_alarms_that_rest_on_outputs(event: object, expected: bool) -> None:
    assert rests_on_outputs(event) is expected


class Axes(VehicleAxes):
    """The axes of vehicle 1 in a flight that only the tests tell of."""

    def __init__(self, surfaces: Surfaces | None = None, **flight: Any) -> None:
        super().__init__(1, 0)
        self.surfaces = surfaces
        known = {"flown_s": 0, "on_ground": False, "has_pulses": True, "parted_s": 0, "by_receiver": ()}
        self.flight = SimpleNamespace(**(known | flight))  # type: ignore[assignment]
        self.adopted: list[tuple[Surfaces | None, str]] = []
        self.inferred = 0

    def _adopt(self, surfaces: Surfaces | None, why: str, limits: Any = None) -> Iterator[Any]:
        self.adopted.append((surfaces, why))
        yield from ()


INFERRED, NAMED = Surfaces(AILERONS, "inferred"), Surfaces(AILERONS, "profile")
CHANNELS = Surfaces((SurfaceOutput(ALL_OUTPUTS + 1, "aileron", 1500, 400),), "profile")


@pytest.mark.parametrize(
    ("surfaces", "flown_s", "has_pulses", "due_s", "ends_s"),
    [
        (None, 55, True, None, 14),  # eager: second by second
        (None, 56, True, None, 20),
        (INFERRED, 0, True, None, 20),
        (CHANNELS, 0, True, None, 20),
        (NAMED, 0, True, None, 14),  # nothing confirms a profile's outputs
        (Surfaces(AILERONS, "parameters"), 0, True, None, 30),
        (Surfaces(AILERONS, "parameters"), 0, False, None, 20),  # the receiver may drive the servos
        (Surfaces(AILERONS, "parameters"), 0, True, 17, 17),
        (INFERRED, 0, True, 17, 17),
        (INFERRED, 0, True, 25, 20),
    ],
)
def test_seconds_are_followed_until_the_surfaces_may_change(
    surfaces: Surfaces | None, flown_s: int, has_pulses: bool, due_s: int | None, ends_s: int
) -> None:
    axes = Axes(surfaces, flown_s=flown_s, has_pulses=has_pulses)
    if due_s is not None:
        axes.setups.add_parameters(due_s - 10, parameters(1))
    now, rest = axes._next(Seconds(np.arange(13, 30), {}))
    assert now.index.tolist() == [*range(13, ends_s)]
    assert (rest is None) == (ends_s == 30)


def test_outputs_are_inferred_ever_more_rarely_and_three_times_at_most(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[int] = []

    def last(*given: int) -> tuple[str, str]:
        asked.append(axes.flight.flown_s)
        return "rows", "pulses"

    found: list[Surfaces | None] = [None]
    monkeypatch.setattr(vehicle_axes, "inferred", lambda rows, pulses: found[-1])
    axes = Axes(last=last)
    tried = []
    for axes.flight.flown_s in range(700):
        if axes.flight.flown_s >= axes._next_try_s:
            tried.append(axes.flight.flown_s)
            assert [*axes._infer()] == []
    # The first try is at 45 s; the next one 10 s later, or later by a quarter of the flight.
    assert tried[:4] == [45, 56, 70, 87]
    assert asked == [second for second in tried if second <= 600]
    assert not axes.adopted
    axes._hoped_s, axes.flight.flown_s = 100, 700
    found.append(INFERRED)
    for _ in range(5):
        assert [*axes._infer()] == []
    assert axes.adopted == [(INFERRED, "its outputs are inferred from the flight")] * 3
    boat = Axes(last=last, on_ground=True)
    assert [*boat._infer()] == []
    assert not boat.adopted


@pytest.mark.parametrize(
    ("second", "now_s", "looks"), [(30, 30, True), (30, 31, False), (39, 31, False), (40, 31, True)]
)
def test_inferred_outputs_are_looked_at_every_ten_seconds(second: int, now_s: int, looks: bool) -> None:
    axes = Axes(INFERRED, flown_s=100, parted_s=3)
    axes._now_s = now_s
    assert [*axes._look(second)] == []
    assert axes.adopted == ([(None, "outputs that moved as one no longer do")] if looks else [])
    if looks:
        assert (axes._hoped_s, axes._next_try_s) == (100, 110)


def test_the_end_of_the_input_is_always_a_time_to_look() -> None:
    axes = Axes(INFERRED, flown_s=4, parted_s=3)
    axes._now_s = 5
    assert [*axes.feed([], final=True)] == []
    assert len(axes.adopted) == 1


def test_outputs_that_parted_for_two_seconds_are_still_one() -> None:
    axes = Axes(INFERRED, flown_s=100, parted_s=2)
    assert [*axes._look(0)] == []
    assert not axes.adopted


@pytest.mark.parametrize(
    ("flown_s", "asked_s"), [(59, []), (60, [60]), (119, [60]), (120, [60, 120]), (999, [60, 120, 180])]
)
def test_the_motion_is_asked_three_times_in_the_first_minutes(flown_s: int, asked_s: list[int]) -> None:
    asked = []

    class Asked(Axes):
        def _ask(self, surfaces: Surfaces, axes: Sequence[str], until_s: int, alarmed: str = "") -> None:
            asked.append((self.flight.flown_s, tuple(axes), until_s, alarmed))

    axes = Asked(NAMED)
    for axes.flight.flown_s in range(flown_s + 1):
        axes._now_s = 2 * axes.flight.flown_s
        assert axes._refuted([]) is None
    assert asked == [(at, ("roll",), 2 * at, "") for at in asked_s]
    asked.clear()
    axes.flight.flown_s = 50
    assert axes._refuted([changed("normal"), changed("degraded", axis="yaw", time_s=70.9)]) is None
    assert asked == [(50, ("roll",), 70, "yaw")]
    axes.surfaces = Surfaces(AILERONS, "parameters")
    axes._refuted([changed("degraded")])
    assert len(asked) == 1, "what parameters name is not asked about"


def test_what_refutes_roll_refutes_yaw_and_no_parameter_is_overruled() -> None:
    axes = Axes(NAMED)
    axes._answers = {"roll": "wrong", "pitch": ""}
    assert axes._as_it_moves(NAMED).contradicted == {"roll": "wrong", "yaw": "wrong"}
    for told in ({"confirmed": frozenset({"roll"})}, {"by_log": frozenset({"roll"})}):
        sure = Surfaces(AILERONS, "profile", **told)  # type: ignore[arg-type]
        assert axes._as_it_moves(sure) is sure
    axes._answers = {"pitch": "wrong"}
    assert axes._as_it_moves(NAMED).contradicted == {"pitch": "wrong"}


@pytest.mark.parametrize(
    ("alarmed", "before", "asked", "after"),
    [
        ("", {}, ["contradiction"], {"roll": "c"}),
        ("", {"roll": ""}, [], {"roll": ""}),
        ("roll", {"roll": ""}, ["refutation"], {"roll": "r"}),
        ("yaw", {"roll": ""}, ["refutation"], {"roll": "r"}),
        ("pitch", {"roll": ""}, [], {"roll": ""}),
        ("roll", {"roll": "wrong"}, [], {"roll": "wrong"}),
        ("roll", {}, ["contradiction"], {"roll": "c"}),
    ],
)
def test_an_axis_is_asked_about_until_an_answer_is_clear(
    alarmed: str,
    before: dict[str, str],
    asked: list[str],
    after: dict[str, str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls: list[str] = []

    def answer(name: str) -> Any:
        def found(*_: object) -> str:
            calls.append(name)
            return name[0]

        return found

    monkeypatch.setattr(vehicle_axes, "contradiction", answer("contradiction"))
    monkeypatch.setattr(vehicle_axes, "refutation", answer("refutation"))
    monkeypatch.setattr(vehicle_axes, "replace", lambda rows, **_: rows)
    axes = Axes(NAMED, last=lambda *_: ("rows", np.full((3, ALL_OUTPUTS), 1500.0)))
    axes._answers = dict(before)
    axes._ask(NAMED, ["roll"], 9, alarmed)
    assert (calls, axes._answers) == (asked, after)
    axes.flight.last = lambda *_: None  # type: ignore[method-assign]
    axes._ask(NAMED, ["pitch"], 9, "pitch")
    assert calls == asked


def test_a_judgement_made_anew_is_told_by_one_change() -> None:
    axes = Axes(NAMED)
    axes._now_s = 50
    assert [*axes._revised("roll", "normal", changed("normal"), "why")] == []
    assert [*axes._revised("roll", "undecided", None, "why")] == []
    for last, expected in (
        (
            None,
            ConditionChanged(
                1, "roll", 50.0, 50.0, "degraded", "undecided", "undecided: why", "effectiveness"
            ),
        ),
        (
            changed("normal"),
            ConditionChanged(1, "roll", 50.0, 50.0, "degraded", "normal", "normal: why", "effectiveness"),
        ),
    ):
        assert [*axes._revised("roll", "degraded", last, "why")] == [expected]
    [found] = axes._revised("roll", "degraded", changed("emergency"), "why")
    assert isinstance(found, ConditionChanged)
    assert (found.time_s, found.since_s, found.before, found.rule) == (
        50.0,
        5.0,
        "degraded",
        "emergency: rule",
    )


def test_an_indication_is_reported_once_and_an_alert_names_the_surface() -> None:
    axes = Axes(NAMED)
    assert len([*axes._report(indication(1.0, 2.0))]) == 1
    [second] = axes._report(indication(2.0, 3.0, 4.0))
    assert isinstance(second, Indication)
    assert second.end_s.tolist() == [3.0, 4.0]
    assert (second.value - second.end_s).tolist() == [1.0, 1.0]
    assert (second.low - second.end_s).tolist() == [2.0, 2.0]
    assert (second.high - second.end_s).tolist() == [3.0, 3.0]
    assert [*axes._report(indication(4.0))] == []
    [alert] = axes._report(changed("degraded"))
    assert isinstance(alert, ConditionChanged)
    assert alert.finding == f"roll is lost: {NAMED.brief('roll')}?"
    axes.surfaces = None
    assert [*axes._report(changed("degraded"))] == [changed("degraded")]


def test_a_contradiction_is_said_once() -> None:
    axes = Axes(Surfaces(AILERONS, "profile", contradicted={"roll": "one", "yaw": "one", "pitch": "two"}))
    axes._now_s = 7
    assert [*axes._contradicted(None)] == [Notice(7.0, 1, "one"), Notice(7.0, 1, "two")]
    before = Surfaces(AILERONS, "profile", contradicted={"pitch": "one"})
    assert [*axes._contradicted(before)] == [Notice(7.0, 1, "two")]


@pytest.mark.parametrize(
    ("surfaces", "is_whole", "differs"),
    [
        (NAMED, True, False),
        (INFERRED, False, False),
        (Surfaces(tuple(SurfaceOutput(s, "aileron", 1500, 300) for s in (1, 2)), "profile"), True, True),
        (Surfaces(tuple(SurfaceOutput(s, "aileron", 1500, 300) for s in (1, 2)), "profile"), False, False),
        (Surfaces(tuple(SurfaceOutput(s, "aileron", 1500, 300) for s in (1, 3)), "profile"), False, True),
        (
            Surfaces(
                tuple(SurfaceOutput(s, "aileron", 1500, 300) for s in (1, 2)),
                "profile",
                contradicted={"yaw": "x"},
            ),
            False,
            True,
        ),
    ],
)
def test_other_ranges_alone_do_not_give_up_a_long_flight(
    surfaces: Surfaces, is_whole: bool, differs: bool
) -> None:
    axes = Axes(NAMED, past=SimpleNamespace(is_whole=is_whole))
    assert axes._differs(surfaces) is differs
    assert Axes(None)._differs(surfaces)
