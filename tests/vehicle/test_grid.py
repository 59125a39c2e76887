"""Lateness stream by stream, when a second is settled, and what lies between samples."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.vehicle.arrivals import HORIZON_S, Arrivals, Order, Received
from mavhums.vehicle.facts import Signal
from mavhums.vehicle.grid import RATE_HZ, Grid
from tests.present import present
from tests.strategies import cuts

Array = NDArray[np.float64]
COLUMNS = {"outputs": 16, "rates": 3, "rates 2": 3, "attitude": 3, "airspeed": 1, "state": 4}
UNSTAMPED = ("airspeed", "state")


def arrivals(times: Mapping[str, Array], latency: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return stream and time of every sample in order of arrival."""
    all_ = [(time + latency.get(name, 0.0), name, time) for name, found in times.items() for time in found]
    return [(name, time) for _, name, time in sorted(all_)]


def signals(rows: list[tuple[str, float]], first: int = 0) -> list[Signal]:
    found = []
    for name in dict.fromkeys(name for name, _ in rows):
        frame = [first + k for k, row in enumerate(rows) if row[0] == name]
        time_us = np.array([round(time * 1e6) for other, time in rows if other == name], dtype=np.int64)
        values = np.sin(time_us[:, None] / 1e6 + np.arange(COLUMNS[name]))
        stamped = name not in UNSTAMPED
        signal, _, rank = name.partition(" ")  # a second stream of the same signal
        found.append(Signal(1, signal, name, np.array(frame), time_us, values, stamped, int(rank or 0)))
    return found


def even(hz: float, seconds: float, begin: float = 0.0) -> Array:
    return begin + np.arange(round(hz * seconds)) / hz


@pytest.mark.slow
@given(
    st.fixed_dictionaries({name: st.floats(0.0, 5.0) for name in ("outputs", "rates", "attitude")}),
    st.integers(0, 50),
)
def test_any_latency_of_each_stream_gives_the_same_seconds(latency: dict[str, float], phase: int) -> None:
    times = {name: even(4.0, 60.0, 0.01 * (phase + 7 * k) % 0.25) for k, name in enumerate(latency)}
    expected, grid = present(Grid(0).feed(signals(arrivals(times, {})), final=True)), Grid(0)
    found = present(grid.feed(signals(arrivals(times, latency)), final=True))
    assert np.array_equal(found.index, expected.index)
    for name, values in expected.signals.items():
        np.testing.assert_array_equal(found.signals[name], values)
    assert all(received.late == received.repeated == 0 for received in grid.received().values())


@given(
    st.lists(
        st.tuples(
            st.sampled_from(list(COLUMNS)), st.sampled_from([0.0, 0.2, 0.4, 1.1, 3.0, 12.0, 40.0, -1.0, -9.0])
        ),
        max_size=120,
    ),
    st.data(),
)
def test_seconds_do_not_depend_on_the_blocks(steps: list[tuple[str, float]], data: st.DataObject) -> None:
    """Whatever order, pauses and dead streams: what is settled is settled, and the counts are the same."""
    names, pauses = zip(*steps, strict=True) if steps else ((), ())
    rows = [*zip(names, itertools.accumulate(pauses), strict=True)]
    whole, grid = Grid(0), Grid(0)
    wanted = [one for one in (whole.feed(signals(rows)), whole.feed([], final=True)) if one]
    edges = itertools.pairwise([0, *data.draw(cuts(len(rows))), len(rows)])
    fed = [*(grid.feed(signals(rows[a:b], a)) for a, b in edges), grid.feed([], final=True)]
    parts = [one for one in fed if one]
    assert grid.received() == whole.received()
    assert [i for one in parts for i in one.index] == [i for one in wanted for i in one.index]
    for name in wanted[0].signals if wanted else ():
        got = np.concatenate([one.signals[name] for one in parts])
        np.testing.assert_array_equal(got, np.concatenate([one.signals[name] for one in wanted]))


@pytest.mark.parametrize("late_s", [29.0, 29.9, 30.0, 30.3, 30.9, 31.0])
def test_a_stream_as_late_as_the_horizon_is_as_late_in_any_block(late_s: float) -> None:
    """What comes once a second is settled cannot be known there, though a large block holds it."""
    times = {"attitude": even(10.0, 50.0), "outputs": even(4.0, 50.0)}
    rows, whole, grid = arrivals(times, {"outputs": late_s}), Grid(0), Grid(0)
    wanted = [present(whole.feed(signals(rows))), present(whole.feed([], final=True))]
    parts = [one for k, row in enumerate(rows) if (one := grid.feed(signals([row], k)))]
    parts.append(present(grid.feed([], final=True)))
    for name in wanted[0].signals:
        got, expected = (np.concatenate([one.signals[name] for one in some]) for some in (parts, wanted))
        np.testing.assert_array_equal(got, expected)


def test_a_healthy_link_settles_a_second_when_all_streams_have_passed_it() -> None:
    order = Order()
    for name, time in arrivals({name: even(4.0, 40.0) for name in COLUMNS}, {}):
        row = signals([(name, time)])
        order.feed([Arrivals(name, row[0].frame, row[0].time_us / 1e6)])
        if time > 11.0:
            assert time - order.complete_until_s < 1.3


def test_a_stream_that_has_died_is_waited_for_within_the_horizon_only() -> None:
    times = {"attitude": even(4.0, 100.0), "outputs": even(4.0, 20.0)}
    order, waited = Order(), []
    for name, time in arrivals(times, {}):
        row = signals([(name, time)])
        order.feed([Arrivals(name, row[0].frame, row[0].time_us / 1e6)])
        waited.append(time - order.complete_until_s)
    assert 25.0 < max(waited[80:]) <= HORIZON_S + 1.0
    assert waited[-1] < 1.3


def test_every_sample_is_counted() -> None:
    rows = [("attitude", time) for time in (0.0, 0.5, 0.4, 0.5, 20.0, 60.0, 21.0)]
    rows += [("rates", 20.0), ("rates", 60.0)]
    grid = Grid(0)
    grid.feed(signals(rows), final=True)
    assert grid.received() == {"attitude": Received(4, 2, 1), "rates": Received(1, 1, 0)}


def test_what_is_kept_of_a_hostile_stream_is_bounded() -> None:
    """One stream does not change, or creeps, while another one goes on."""
    grid = Grid(0)
    for k in range(200):
        rows = [("attitude", k + j * 1e-6) for j in range(500)]
        grid.feed(signals([*rows, ("outputs", 1e-3 * k)], 501 * k))
    assert grid.held < 2000


def test_a_second_is_given_as_soon_as_it_has_ended() -> None:
    found = present(Grid(0).feed(signals(arrivals({name: even(4.0, 12.5) for name in COLUMNS}, {}))))
    assert found.index[-1] == 11


def test_an_altitude_is_no_angle() -> None:
    """Between two samples more than π apart it lies half-way, and not across a turn."""
    time_us = np.arange(0, 10_000_001, 500_000)
    frame = np.arange(time_us.size)
    climbed = Signal(1, "altitude", "altitude", frame, time_us, even(0.2, 105.0)[:, None], True, 0)
    found = present(
        Grid(0).feed([climbed, *signals(arrivals({"attitude": even(4.0, 10.0)}, {}))], final=True)
    )
    seconds = (found.index[:, None] + np.arange(RATE_HZ) / RATE_HZ)[2:8]
    speed = np.diff(found.signals["altitude"][2:8, :, 0]) * RATE_HZ
    np.testing.assert_allclose(speed, np.full((len(seconds), RATE_HZ - 1), 10.0), rtol=1e-6)


@pytest.mark.parametrize("start_s", [0, 7, 100])
def test_seconds_before_the_start_are_counted_below_zero(start_s: int) -> None:
    """Samples of a stream that was on its way when the first one came."""
    rows = arrivals({"attitude": even(4.0, 20.0), "outputs": even(4.0, 20.0)}, {})
    expected = present(Grid(0).feed(signals(rows), final=True))
    found = present(Grid(start_s * 1_000_000).feed(signals(rows), final=True))
    assert (found.index + start_s).tolist() == expected.index.tolist()
