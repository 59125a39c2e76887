"""Reading from disk: whole logs as tables, and files that are no logs."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

import mavhums
from mavhums.core.errors import UnreadableLogError
from mavhums.log import Decoder, Table, read_blocks, read_log
from mavhums_sim import FlightRecord
from tests.log.dataflash.synthetic import definition, fmt_of_fmt, stream
from tests.log.decode import frames_in
from tests.log.ulog import writer
from tests.present import present


def test_read_log_gives_tables_by_time_of_reception(growing_log: Path, growing_record: FlightRecord) -> None:
    log = read_log(growing_log)
    frame = log.messages["DEBUG_FLOAT_ARRAY"]
    elevator = frame[frame["array_id"] == 3]
    truth = growing_record.actuators["elevator"].values
    assert np.allclose(elevator[[f"data[{k}]" for k in range(12)]], truth, rtol=1e-6, atol=1e-6)
    assert (elevator["name"] == "EMA").all()
    assert frame.index.is_monotonic_increasing
    assert str(frame.index.dtype) == "datetime64[us, UTC]"
    assert log.vehicles == (1,)
    assert not log.losses.any
    assert np.diff(present(log.span)) == pytest.approx(40e6, rel=0.01)


def test_actuators_give_histories_by_name(growing_log: Path, growing_record: FlightRecord) -> None:
    histories = mavhums.actuators(mavhums.read_log(growing_log))
    assert set(histories) == {"aileron_left", "aileron_right", "elevator", "rudder"}
    elevator, truth = histories["elevator"], growing_record.actuators["elevator"]
    assert np.allclose(elevator.frame["V5"], truth.values[:, 4], atol=1e-6)
    assert elevator.provenance["V11"] == "DEBUG_FLOAT_ARRAY[EMA,3].data[10]"
    seconds = (elevator.frame.index - elevator.frame.index[0]).total_seconds()
    assert np.allclose(seconds, truth.time_s - truth.time_s[0], atol=2e-6)


def test_tables_join_and_select(short_log: Path) -> None:
    whole = read_log(short_log, messages=["ATTITUDE"]).tables["ATTITUDE"]
    decoder = Decoder(["ATTITUDE"])
    fed = map(decoder.feed, read_blocks(short_log, size=5_000))
    joined = Table.concatenate([table for tables in fed for table in tables.values()])
    assert np.array_equal(joined["roll"], whole["roll"])
    assert np.array_equal(joined.frame, whole.frame)
    assert len(whole.select(whole["roll"] > 0)) == np.count_nonzero(whole["roll"] > 0)


TOPIC = writer.form("topic", "uint64_t timestamp;float value;") + writer.subscribe(1, "topic")


@pytest.mark.parametrize(
    ("name", "content", "problem", "remedy"),
    [
        ("empty.tlog", b"", "empty", "closed the log"),
        ("log.BIN", b"\xa3\x95\x80\x80" + bytes(100), "DataFlash", "firmware"),
        ("log.ulg", b"ULog\x01\x12\x35" + bytes(100), "ULog", "copy"),
        ("flight.rrd", b"RRF2" + bytes(100), "Rerun", ".tlog"),
        ("log.gz", b"\x1f\x8b" + bytes(100), "damaged", "unpack"),
        ("log.zip", b"PK\x03\x04" + bytes(100), "damaged", "unpack"),
        ("notes.txt", "Fuß und Hand\n".encode() * 20, "text file", ".tlog"),
        ("noise.tlog", bytes(range(128, 256)) * 40, "neither a MAVLink frame nor", ".tlog"),
        (
            "old.bin",
            fmt_of_fmt() + definition(3, "ATT", "Ic", "TimeMS,Roll") + bytes(300),
            "older than TimeUS",
            ".tlog",
        ),
        (
            "old.px4log",
            definition(2, "ATT", "f", "Roll") + definition(129, "TIME", "Q", "StartTime") + bytes(300),
            "PX4 from before ULog",
            "",
        ),
        ("headless.bin", b"".join(stream(1, 200)[10:]), "FMT", "same firmware"),
        ("flight.log", b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name\nATT, 1000, 0, 0\n", "text", ".BIN"),
        ("newer.ulg", writer.header(incompatible=2) + TOPIC, "needs a newer reader", ""),
        ("noise.ulg", writer.MAGIC + bytes(9), "no message", ""),
        ("ground.ulg", writer.header() + writer.parameter("A", 1) * 3, "no topic", ""),
    ],
)
def test_what_is_no_log_is_named(
    tmp_path: Path, name: str, content: bytes, problem: str, remedy: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(UnreadableLogError, match=problem) as caught:
        read_log(path)
    assert str(path) in caught.value.problem
    assert remedy in caught.value.remedy


def test_a_log_without_time_stamps_is_read_on_the_senders_clock(short_log: Path, tmp_path: Path) -> None:
    raw = tmp_path / "flight.tlog.raw"
    raw.write_bytes(b"".join(frames_in(short_log.read_bytes())))
    stamped, log = read_log(short_log), read_log(raw)
    assert log.sender_clock
    assert not stamped.sender_clock
    assert not log.losses.any
    assert log.counts == stamped.counts
    for name, table in stamped.tables.items():
        assert log.tables[name].fields.tobytes() == table.fields.tobytes()
    attitude = log.tables["ATTITUDE"]
    assert np.array_equal(attitude.time_us, attitude["time_boot_ms"].astype(np.int64) * 1000)
    assert present(log.span)[1] == attitude.time_us.max()


def test_the_standard_input_is_read(short_log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with short_log.open("rb") as file, io.TextIOWrapper(file) as text:
        monkeypatch.setattr("sys.stdin", text)
        log = read_log("-")
    assert log.counts == read_log(short_log).counts


def test_missing_files_and_folders_are_named(tmp_path: Path) -> None:
    with pytest.raises(UnreadableLogError, match="no such file"):
        read_log(tmp_path / "missing.tlog")
    with pytest.raises(UnreadableLogError, match=r"folder.*\*\.tlog"):
        read_log(tmp_path)


def test_a_file_that_may_not_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "flight.tlog"
    path.touch()

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("os.open", refuse)
    with pytest.raises(UnreadableLogError, match="Permission denied"):
        read_log(path)
