"""The decoder: blocks, clocks, vehicles, losses, refusals."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavhums import read_log
from mavhums.app.inspection import inspect_log
from mavhums.log.base.decoder import ODD_TIME
from tests.conftest import Run
from tests.log.decode import assert_cuts_do_not_matter, decode
from tests.log.ulog import writer
from tests.log.ulog.peer import columns_of_peer
from tests.present import present

FLIGHT = writer.flight(2.0)
TOPIC = writer.form("topic", "uint64_t timestamp;float value;") + writer.subscribe(1, "topic")


def row(time_us: int, value: float = 0.0, number: int = 1) -> bytes:
    return writer.data(number, struct.pack("<Qf", time_us, value))


@settings(max_examples=40, deadline=None)
@given(cuts=st.lists(st.integers(0, len(FLIGHT)), max_size=8).map(sorted), damage=st.booleans())
def test_where_blocks_end_never_matters(cuts: list[int], damage: bool) -> None:
    log = FLIGHT[:3000] + bytes(70) + FLIGHT[3040:] if damage else FLIGHT
    assert_cuts_do_not_matter(log, cuts)


def test_names_instances_and_units_are_the_formats_own() -> None:
    tables, decoder = decode(FLIGHT)
    outputs = tables["actuator_outputs"]
    assert np.unique(outputs.component).tolist() == [0, 1]
    assert outputs["output"].shape == (len(outputs), 16)
    assert tables["esc_status"]["esc[3].esc_rpm"].tolist() == [300 + 5 * k for k in range(20)]
    assert "_padding0" not in (tables["esc_status"].fields.dtype.names or ())
    assert decoder.format == "ulog"
    assert decoder.vehicles == (7,)
    assert set(outputs.system.tolist()) == {7}
    assert decoder.counts[7, 1, "actuator_outputs"] == 20
    assert decoder.losses.logger_dropped == 1
    assert not decoder.losses.any


def test_the_first_fix_dates_the_whole_log() -> None:
    tables, decoder = decode(FLIGHT)
    assert not decoder.undated
    assert decoder.first_time_us == 1_700_000_005_000_000
    attitude = tables["vehicle_attitude"]
    shifts = attitude.time_us - attitude["timestamp"].astype(np.int64)
    assert shifts.tolist() == [1_700_000_000_000_000] * 100


def test_without_a_fix_times_count_from_boot() -> None:
    _, decoder = decode(writer.flight(1.0, fix_from=None))
    assert decoder.undated
    assert decoder.first_time_us == 5_000_000


def test_a_fix_behind_the_first_megabyte_dates_nothing() -> None:
    late = writer.flight(240.0, fix_from=11_900)
    assert len(late) > 1 << 20
    assert decode(late)[1].undated


def test_appended_data_begins_where_the_flags_say_though_a_message_is_cut_there() -> None:
    whole = writer.header(appended=[1]) + TOPIC + row(1_000_001, 1.0)
    cut = row(1_000_002, 2.0)[:9]
    log = writer.header(appended=[len(whole + cut)]) + TOPIC + row(1_000_001, 1.0) + cut + row(1_000_003, 3.0)
    tables, decoder = decode(log)
    assert tables["topic"]["value"].tolist() == [1.0, 3.0]
    assert decoder.losses.cut_end_bytes == len(cut)
    assert decoder.losses.bytes_skipped == 0


def test_a_cut_end_is_reported_as_such() -> None:
    log = writer.header() + TOPIC + row(1_000_001) + row(1_000_002)[:-3]
    tables, decoder = decode(log)
    assert len(tables["topic"]) == 1
    assert decoder.losses.cut_end_bytes == len(row(0)) - 3


def test_an_odd_time_is_flagged_and_does_not_move_the_clock() -> None:
    times = [1_000_000, 1_010_000, 9_000_000_000, 1_030_000]
    tables, decoder = decode(writer.header() + TOPIC + b"".join(map(row, times)))
    topic = tables["topic"]
    assert topic.time_us.tolist() == [1_000_000, 1_010_000, 1_010_000, 1_030_000]
    assert (topic.flags & ODD_TIME).astype(bool).tolist() == [False, False, True, False]
    assert decoder.losses.implausible_times == 1


def test_what_was_published_before_the_logger_began_is_no_damage_and_no_jump() -> None:
    old = [301_000_000, 0, 100_000_000, 100_000_001, 100_000_002, 100_000_003, 301_010_000]
    tables, decoder = decode(writer.header(300_000_000) + TOPIC + b"".join(map(row, old)))
    assert tables["topic"].time_us.tolist() == [301_000_000] * 6 + [301_010_000]
    assert not decoder.losses.any


def test_three_times_in_a_row_set_the_clock() -> None:
    later = 9_000_000_000
    times = [1_000_000, later, later + 1, later + 2, later + 3]
    tables, decoder = decode(writer.header() + TOPIC + b"".join(map(row, times)))
    assert tables["topic"].time_us.tolist() == [1_000_000, 1_000_000, 1_000_000, later + 2, later + 3]
    assert decoder.losses.time_jumps == 1


def test_a_topic_without_a_time_is_no_damage() -> None:
    tables, decoder = decode(writer.header() + TOPIC + row(0) + row(0) + row(0))
    assert len(tables["topic"]) == 3
    assert not decoder.losses.any


def test_data_without_a_layout_is_counted() -> None:
    lost = b"".join(row(1_000_000 + k, number=4) for k in range(3))
    log = writer.header() + TOPIC + row(1_000_000) + writer.subscribe(4, "undefined") + lost + row(1_000_009)
    tables, decoder = decode(log)
    assert len(tables["topic"]) == 2
    assert decoder.unknown == {4: 3}


def test_a_kind_of_message_to_come_is_counted_and_passed_over() -> None:
    new = writer.message("Z", b"something new")
    _, decoder = decode(writer.header() + TOPIC + row(1_000_000) + new + row(1_000_001) + row(1_000_002))
    assert decoder.counts == {(1, 0, "topic"): 3}
    assert decoder.unknown == {-1: 1}
    assert not decoder.losses.any


UNUSABLE = [
    "topic:topic[3] again;", "topic:uint8_t[99999] huge;", "topic:missing part;", "topic:",
    "topic:float twice;float twice;", "topic", "topic:float[x] what;", "parameter:uint64_t timestamp;",
]  # fmt: skip


@pytest.mark.parametrize("formats", UNUSABLE)
def test_formats_that_cannot_be_used_leave_their_records_unknown(formats: str) -> None:
    name = formats.partition(":")[0]
    log = writer.header() + writer.message("F", formats.encode()) + writer.subscribe(1, name)
    tables, decoder = decode(log + row(1_000_000) + row(1_000_001))
    assert tables == {}
    assert decoder.unknown == {1: 2}


def test_formats_within_formats_do_not_explode() -> None:
    forms = [writer.form(f"t{k}", f"t{k + 1}[65535] a;") for k in range(9)] + [writer.form("t9", "t10[9] a;")]
    forms += [writer.form("t10", "float[0] none;")]
    tables, _ = decode(writer.header() + b"".join(forms) + writer.subscribe(1, "t0") + row(1))
    assert tables == {}


@pytest.mark.parametrize("name", ["Attitude", "sensors/imu-0", "IMU", "attitude"])
def test_topics_of_other_writers_are_read_as_pyulog_reads_them(run: Run, name: str, tmp_path: Path) -> None:
    """Names in capitals alone are those of messages of other formats: the topic is not one of them."""
    form = writer.form(name, "uint64_t timestamp;float Roll.deg;float x_2;")
    rows = [struct.pack("<Qff", 1_000_000 + 10_000 * k, k, 2.0 * k) for k in range(50)]
    log = writer.header() + form + writer.subscribe(3, name) + b"".join(writer.data(3, one) for one in rows)
    path = tmp_path / "other.ulg"
    path.write_bytes(log)
    [table] = read_log(path).tables.values()
    assert table.name == ("ulog_IMU" if name == "IMU" else name)
    theirs = columns_of_peer(log)[name, 0]
    for field in ("timestamp", "Roll.deg", "x_2"):
        assert table[field].tolist() == theirs[field].tolist()
    [vehicle] = inspect_log(path).vehicles
    assert vehicle.tier is None
    assert run("export", path, "--messages", table.name, "-o", f"{path}.csv").code == 0


def several(stamps_us: list[int], start_us: int = 1_000_000) -> bytes:
    """Three topics that are logged together, each with one time."""
    fields = "uint64_t timestamp;float value;"
    head = (writer.form(f"t{k}", fields) + writer.subscribe(k, f"t{k}") for k in range(3))
    rows = (row(at_us, number=k) for at_us in stamps_us for k in range(3))
    return writer.header(start_us) + b"".join([*head, *rows])


@pytest.mark.parametrize("at", [0, 1, 250, 599])
def test_one_wrong_time_of_several_topics_sets_no_clock(at: int) -> None:
    stamps = [1_000_000 + 500_000 * k for k in range(600)]
    stamps[at] = 5_519_000_000
    tables, decoder = decode(several(stamps))
    lasted_us = present(decoder.last_time_us) - present(decoder.first_time_us)
    assert lasted_us / 1e6 == pytest.approx(299.5, abs=0.6)
    assert decoder.losses.time_jumps == 0
    assert len(tables["t0"]) == 600


def test_a_header_without_a_time_does_not_lengthen_the_log() -> None:
    _, decoder = decode(several([5_228_000_000 + 500_000 * k for k in range(600)], start_us=0))
    assert decoder.first_time_us == 5_228_000_000
    assert decoder.last_time_us == 5_228_000_000 + 299_500_000
