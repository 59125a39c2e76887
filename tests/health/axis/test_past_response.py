"""An axis judged by the response of the aircraft's earlier flights."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest

from mavhums.core.conditions import Condition
from mavhums.health.axis.past import compare_response
from mavhums.health.axis.response import ResponseSums
from mavhums.health.estimation.least_squares import unpacked
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.results.verdict import OwnRecord, Verdict
from mavhums.vehicle.flight import SPEEDS
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.rows import Rows
from tests.health import builders
from tests.health.axis.flights import SPEED, excited, lagged, late, rows, steady
from tests.present import present

START = datetime(2026, 3, 1, 9, tzinfo=UTC)
GAIN, TRIM, TURN = 0.12, 0.01, -0.3  # rad/m, rad/m, 1
SENSOR, TRIANGLE = "the airspeed sensor", "the wind triangle"


def flight(
    seconds: int, *, seed: int = 1, gain: float = GAIN, left: float = 1.0, since: int = 0, gusts: float = 0.02
) -> Rows:
    """Return a flight whose roll rate obeys p = K·v·δ + b·v + c·r, in gusts; K falls from a second on."""
    made = steady(seconds)
    n = seconds * RATE_HZ
    command = excited(seconds, seed, 0.3)
    share = np.where(np.arange(n) < since * RATE_HZ, 1.0, left)
    made["outputs"][:, 0] = command
    made["yaw_rate"] = excited(seconds, seed + 1000, 0.1)
    made["speed"] = SPEED + 2.0 * excited(seconds, seed + 2000, 0.5)
    answer = late(lagged(share * command, 0.1, start=share[0] * command[0]), 3)  # as the sums assume it
    made["roll_rate"] = gain * made["speed"] * answer + TRIM * made["speed"] + TURN * made["yaw_rate"]
    made["roll_rate"] += gusts * np.random.default_rng(seed).normal(size=n)
    return rows(made)


def record(flown: Rows, *, block: int = 1 << 20, setup: str = SENSOR, rate_hz: float = 10.0) -> OwnRecord:
    sums = ResponseSums("roll")
    for begin in range(0, flown.seconds, block):
        sums.feed(flown.cut(begin, min(begin + block, flown.seconds)))
    found = present(sums.response())
    return found.record(setup, rate_hz)


def healthy(count: int = 5, **how: Any) -> list[tuple[OwnRecord]]:
    """Return earlier flights, whose gain scatters by 2 %."""
    gains = GAIN * (1.0 + 0.02 * np.cos(np.arange(count)))
    return [(record(flight(120, seed=k, gain=gain), **how),) for k, gain in enumerate(gains.tolist(), 10)]


PAST = healthy()
MORE = healthy(20)


def judged(
    own: OwnRecord | None,
    past: list[tuple[OwnRecord]],
    *,
    condition: Condition = "undecided",
    others: tuple[Verdict, ...] = (),
) -> Verdict:
    reason = "too little is explained" if condition == "undecided" else None
    verdict = axis(condition).model_copy(update={"own": (own,) if own else (), "reason": reason})
    return compare_response(verdict, past, others=others, start_utc=START, false_alarms=1.0)


def axis(condition: Condition, name: str = "roll") -> Verdict:
    return builders.verdict(condition, subject="axis", actuator=name)


def test_the_sums_hold_the_gain_exactly() -> None:
    flown = record(flight(60, gusts=0.0))
    gram = np.sum([unpacked(row[3:], 4) for row in flown.groups], axis=0)
    found = np.linalg.solve(gram[:3, :3], gram[:3, 3])
    assert found == pytest.approx([GAIN, TRIM, TURN], rel=0.02)
    assert flown.groups[0][0] == 10.0
    assert flown.groups[0][2] == pytest.approx(SPEED, abs=1.0)


def test_a_long_flight_leaves_no_more_than_a_short_one() -> None:
    flown = record(flight(1000))
    # Each time 32 parts were full, two were joined.
    assert {row[0] for row in flown.groups} == {4.0 * WINDOW_S}
    assert 16 <= len(flown.groups) < 32
    assert flown.duration_s == sum(row[0] for row in flown.groups)
    assert flown.groups[-1][1] >= 960.0


def test_parts_are_of_one_source_of_the_speed_and_of_seconds_with_enough_rows() -> None:
    """The first second only fills the filters; a part ends with its source, and an open one is left out."""
    flown, second = flight(45), np.repeat(np.arange(45), RATE_HZ)
    row = np.arange(len(second)) % RATE_HZ
    sources = np.where((second >= 15) & (second < 22), 1.0, 0.0) + float(SPEEDS) * (second % 3)
    sources[(second == 25) & (row >= 12)] += 1.0
    flying = ~((second == 5) & (row >= 14)) & ~((second == 8) & (row >= 13))
    sums = ResponseSums("roll")
    sums.feed(replace(flown, sources=sources, flying=flying))
    found = present(sums.response())
    assert [row[:2] for row in found.groups] == [(10.0, 12.0), (3.0, 15.0), (10.0, 33.0), (10.0, 43.0)]
    speeds = flown.speed[::RATE_HZ]
    assert found.groups[1][2] == pytest.approx(speeds[12:15].mean(), abs=0.005)
    whole, joined = np.array(found.groups), np.array(found.in_parts(2).groups)
    for k, at in enumerate((slice(0, 2), slice(2, 4))):
        part = whole[at]
        assert joined[k, :2].tolist() == [part[:, 0].sum(), part[-1, 1]]
        assert joined[k, 2] == pytest.approx(np.average(part[:, 2], weights=part[:, 0]), abs=0.005)
        assert joined[k, 3:] == pytest.approx(part[:, 3:].sum(axis=0))
    assert found.in_parts(9).groups == tuple(
        (*row[:3], *(float(f"{one:.9g}") for one in row[3:])) for row in found.groups
    )


def test_an_axis_without_a_reference_is_normal_by_its_earlier_flights() -> None:
    found = judged(record(flight(180)), PAST)
    assert (found.condition, found.worst, found.remedy) == ("normal", "normal", None)
    assert found.reason_codes == ("by_earlier_flights",)
    assert " 5 " in (found.reason or "")
    assert present(found.effectiveness).low < 1.0 < present(found.effectiveness).high
    assert present(found.effectiveness).estimate == pytest.approx(1.0, abs=0.05)
    assert found.coverage.decidable == found.coverage.windows == found.coverage.excluded == 170
    assert found.coverage.excluded_until_s is not None


@pytest.mark.parametrize(("left", "condition"), [(0.3, "emergency"), (0.0, "emergency"), (0.68, "degraded")])
def test_a_loss_is_found_with_its_time(left: float, condition: str) -> None:
    found = judged(record(flight(310, left=left, since=130)), MORE)
    assert (found.condition, found.worst, found.reason) == (condition, condition, None)
    assert present(found.effectiveness).estimate == pytest.approx(left, abs=0.05)
    [evidence] = found.evidence
    assert evidence.kind == found.suspects[0].fault == "effectiveness"
    assert 120.0 <= evidence.start_s <= 190.0
    assert present(found.since).flight_time_s == evidence.start_s
    assert evidence.end_s >= 300.0
    assert "20 earlier flights is left, from 1" in evidence.rule


def test_what_is_not_comparable_is_not_compared() -> None:
    own = record(flight(180, left=0.3))
    before = judged(None, PAST)
    assert before.condition == "undecided"
    for past in (PAST[:-1], healthy(setup=TRIANGLE), healthy(rate_hz=30.3)):
        assert judged(own, past).condition == "undecided"
    assert judged(own, healthy(rate_hz=30.0)).condition == "emergency"
    assert judged(own, PAST, others=(axis("degraded", "yaw"),)).condition == "undecided"
    assert judged(own, PAST, others=(axis("normal", "yaw"),)).condition == "emergency"
    for condition in ("normal", "degraded", "emergency"):
        assert judged(own, PAST, condition=condition).evidence == ()


@pytest.mark.parametrize(
    ("speed", "drive", "condition"),
    [(0.84, 1.0, "undecided"), (0.88, 1.0, "emergency"), (1.0, 1e-6, "undecided")],
)
def test_slow_or_without_a_drive_nothing_is_judged(speed: float, drive: float, condition: str) -> None:
    own = record(flight(180, left=0.3))
    groups = tuple((*row[:2], speed * row[2], *(drive * x for x in row[3:])) for row in own.groups)
    assert judged(own.model_copy(update={"groups": groups}), PAST).condition == condition


@pytest.mark.parametrize(
    "groups",
    [
        ((10.0, 10.0),),
        ((1.0, 2.0, 3.0), (1.0,)),
        ((10.0, 10.0, 18.0, *[0.0] * 10),),
        ((10.0, 10.0, 18.0, 1.0),),
        ((10.0, 10.0, 18.0, *[1e300] * 10),) * 2,
        ((0.0, 10.0, 18.0, *[1.0] * 10),) * 2,
    ],
)
def test_a_foreign_record_is_ignored(groups: tuple[tuple[float, ...], ...]) -> None:
    foreign = OwnRecord(equation="response", setup=SENSOR, rate_hz=10.0, duration_s=10.0, groups=groups)
    assert judged(foreign, PAST).condition == "undecided"
    own = record(flight(180, left=0.3))
    assert judged(own, [*PAST[:-1], (foreign,)]).condition == "undecided"
    assert judged(own, [(foreign,), *PAST]).condition == "emergency"
