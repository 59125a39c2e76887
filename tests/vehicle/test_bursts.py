"""Bursts of samples, joined whatever the blocks and the damage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink import DFReader

from mavhums.core.arrays import Array, Integers
from mavhums.log import Decoder, Table
from mavhums.vehicle.signals import FAST_FORCE_MESSAGES, Bursts
from mavhums_sim.dataflash import records
from mavhums_sim.multirotor.craft import draw_craft, draw_plan
from mavhums_sim.multirotor.flight import fly
from mavhums_sim.multirotor.log import Rates, write_dataflash
from tests.vehicle.tables import table_of

PARTS = 4  # of a burst here


def table(kind: str, frames: list[int], **columns: Any) -> Table:
    made = records(kind, np.array(frames) * 1e-3, **columns)
    return table_of(kind, made.rows, frame=frames, time_us=1000 * np.array(frames))


def joined(rows: list[tuple[str, int, int]], cuts: list[int]) -> list[tuple[float, float]]:
    """Return times and first axes of samples; ``rows`` are kinds, numbers, and parts, in the log's order."""
    bursts, found = Bursts(), list[tuple[float, float]]()
    for a, b in zip([0, *cuts], [*cuts, len(rows)], strict=True):
        tables = {}
        heads = [(k, rows[k][1]) for k in range(a, b) if rows[k][0] == "head"]
        parts = [(k, *rows[k][1:]) for k in range(a, b) if rows[k][0] == "part"]
        if heads:
            frames, numbers = zip(*heads, strict=True)
            own = table("ISBH", [*frames], N=numbers, mul=100, smp_cnt=128, smp_rate=1000.0)
            own.fields["SampleUS"] = own.fields["TimeUS"] - 500
            tables["ISBH"] = own
        if parts:
            frames, numbers, places = zip(*parts, strict=True)
            raw = np.repeat(np.array(numbers)[:, None], 32, axis=1)
            tables["ISBD"] = table("ISBD", [*frames], N=numbers, seqno=places, x=raw, y=raw, z=-raw)
        for one in bursts.feed(tables):
            found += zip((one.time_us / 1e6).tolist(), (100 * one.values[:, 0]).tolist(), strict=True)
    return sorted(found)


ROW = st.tuples(st.sampled_from(["head", "part", "part"]), st.integers(0, 2), st.integers(0, 5000))


@given(st.lists(ROW, max_size=40), st.data())
def test_bursts_do_not_depend_on_how_the_log_is_cut(
    rows: list[tuple[str, int, int]], data: st.DataObject
) -> None:
    cuts = sorted(data.draw(st.sets(st.integers(1, max(len(rows), 1)), max_size=6))) if rows else []
    assert joined(rows, [cut for cut in cuts if cut < len(rows)]) == joined(rows, [])


def test_a_part_has_the_time_and_the_scale_of_the_last_header_of_its_number() -> None:
    rows = [("part", 1, 0), ("head", 1, 0), ("part", 1, 0), ("part", 2, 0), ("head", 1, 0), ("part", 1, 1)]
    found = joined(rows, [])
    assert len(found) == 64, "parts without a header are left out"
    first = [1e-3 - 500e-6 + k * 1e-3 for k in range(32)]
    second = [4e-3 - 500e-6 + (32 + k) * 1e-3 for k in range(32)]
    assert [time_s for time_s, _ in found] == pytest.approx(sorted([*first, *second]), abs=2e-6)
    assert {value for _, value in found} == {1.0}


@pytest.mark.parametrize(
    "damage",
    [{"mul": 0}, {"smp_rate": np.nan}, {"smp_rate": 1e9}, {"smp_rate": -5.0}, {"SampleUS": 2**63}],
)
def test_a_damaged_header_has_no_samples(damage: dict[str, Any]) -> None:
    good: dict[str, Any] = {"N": 1, "mul": 100, "smp_cnt": 128, "smp_rate": 1000.0, "SampleUS": 10**6}
    head = table("ISBH", [0], **{**good, **damage})
    part = table("ISBD", [1], N=1, x=np.ones((1, 32)), y=0, z=0)
    assert [*Bursts().feed({"ISBH": head, "ISBD": part})] == []


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bursts") / "flight.BIN"
    flown = fly(draw_craft(np.random.default_rng(1), "quad x"), draw_plan(np.random.default_rng(2), 20.0), 1)
    write_dataflash(flown, path, Rates(bursts=1000.0, raw=200.0), 1)
    return path


def _decoded(data: bytes, size: int) -> dict[str, tuple[Integers, Array]]:
    decoder, bursts = Decoder(FAST_FORCE_MESSAGES), Bursts()
    found: dict[str, list[tuple[Integers, Array]]] = {}
    for a in range(0, len(data) + size, size):
        for one in bursts.feed(decoder.feed(data[a : a + size], final=a >= len(data))):
            found.setdefault(one.source, []).append((one.time_us, one.values))
    return {
        name: (np.concatenate([time_us for time_us, _ in own]), np.concatenate([force for _, force in own]))
        for name, own in found.items()
    }


def test_the_samples_are_those_that_pymavlink_reads(recorded: Path) -> None:
    known: dict[str, list[tuple[float, ...]]] = {"ISBD": [], "ACC": []}
    heads, reader = {}, DFReader.DFReader_binary(str(recorded))
    while record := reader.recv_match(type=["ISBH", "ISBD", "ACC"]):
        if record.get_type() == "ISBH":
            heads[record.N] = record
        elif record.get_type() == "ACC":
            known["ACC"].append((record.SampleUS, record.AccX, record.AccY, record.AccZ))
        else:
            head = heads[record.N]
            raw = [np.frombuffer(record_axis, "<i2") for record_axis in (record.x, record.y, record.z)]
            for k in range(32):
                at = head.SampleUS + (32 * record.seqno + k) * 1e6 / head.smp_rate
                known["ISBD"].append((at, *(float(axis[k]) / head.mul for axis in raw)))
    reader.close()
    for size in (1 << 20, 9973):
        found = _decoded(recorded.read_bytes(), size)
        for name, rows in known.items():
            times, values = np.array(rows)[:, 0], np.array(rows)[:, 1:]
            assert len(times) > 1000
            assert np.ptp(found[name][0] - times) <= 1.0  # a constant offset: microseconds of UTC
            assert found[name][1] == pytest.approx(values, rel=1e-6)


@given(st.integers(0, 200_000), st.binary(max_size=40))
def test_no_damage_stops_it(recorded: Path, place: int, noise: bytes) -> None:
    data = recorded.read_bytes()[:200_000]
    for time_us, values in _decoded(data[:place] + noise + data[place:], 50_000).values():
        assert len(time_us) == len(values)
        assert np.isfinite(values).all()
