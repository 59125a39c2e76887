"""Specific force that is recorded faster than the streams, whatever the blocks and the damage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink import DFReader

from mavhums.core.arrays import Array, Integers
from mavhums.log import Decoder
from mavhums.vehicle.signals import FAST_FORCE_MESSAGES, fast_forces
from mavhums_sim.multirotor.craft import draw_craft, draw_plan
from mavhums_sim.multirotor.flight import fly
from mavhums_sim.multirotor.log import Rates, write_dataflash


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fast") / "flight.BIN"
    flown = fly(draw_craft(np.random.default_rng(1), "quad x"), draw_plan(np.random.default_rng(2), 20.0), 1)
    write_dataflash(flown, path, Rates(raw=200.0), 1)
    return path


def _decoded(data: bytes, size: int) -> tuple[Integers, Array]:
    decoder = Decoder(FAST_FORCE_MESSAGES)
    found = [
        one
        for a in range(0, len(data) + size, size)
        for one in fast_forces(decoder.feed(data[a : a + size], final=a >= len(data)))
    ]
    assert {one.source for one in found} <= {"ACC"}
    return (
        np.concatenate([np.empty(0, dtype=np.int64), *(one.time_us for one in found)]),
        np.concatenate([np.empty((0, 3)), *(one.values for one in found)]),
    )


def test_the_samples_are_those_that_pymavlink_reads(recorded: Path) -> None:
    known, reader = list[tuple[float, ...]](), DFReader.DFReader_binary(str(recorded))
    while record := reader.recv_match(type=["ACC"]):
        known.append((record.SampleUS, record.AccX, record.AccY, record.AccZ))
    reader.close()
    times, values = np.array(known)[:, 0], np.array(known)[:, 1:]
    assert len(times) > 1000
    for size in (1 << 20, 9973):
        time_us, force = _decoded(recorded.read_bytes(), size)
        assert np.ptp(time_us - times) <= 1.0  # a constant offset: microseconds of UTC
        assert force == pytest.approx(values, rel=1e-6)


@given(st.integers(0, 200_000), st.binary(max_size=40))
def test_no_damage_stops_it(recorded: Path, place: int, noise: bytes) -> None:
    data = recorded.read_bytes()[:200_000]
    time_us, values = _decoded(data[:place] + noise + data[place:], 50_000)
    assert len(time_us) == len(values)
    assert np.isfinite(values).all()
