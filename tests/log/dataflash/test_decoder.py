"""What a log of records becomes: vehicle, UTC, several logs in a file, declared losses, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from mavhums.log import Decoder
from mavhums.log.dataflash import DataFlashDecoder
from tests.log.dataflash.synthetic import FORMATS, definition, of, rcou, record
from tests.log.decode import assert_cuts_do_not_matter
from tests.strategies import cuts

HEAD = b"".join(definition(n, name, letters, columns) for name, (n, letters, columns) in FORMATS.items())
BOOT_UTC_US = 1_767_258_000_000_000  # 2026-01-01 09:00:00
GPS_EPOCH_US = 315_964_800_000_000
WEEK_MS = 7 * 86_400_000


def gps(time_us: int, *, boot_us: int = BOOT_UTC_US, status: int = 3, leap_s: int = 18) -> bytes:
    week, ms = divmod((boot_us + time_us - GPS_EPOCH_US) // 1000 + leap_s * 1000, WEEK_MS)
    return of("GPS", time_us, 0, status, ms, week, 0, 0, 0)


def one_log(system: int = 7, *, boot_us: int = BOOT_UTC_US, seconds: int = 3) -> bytes:
    parts = [HEAD, of("PARM", 1000, b"SYSID_THISMAV", float(system))]
    parts += [rcou(10_000 * k) for k in range(1, 100)]
    parts.append(gps(1_000_000, boot_us=boot_us))
    parts += [rcou(10_000 * k) for k in range(101, 100 * seconds)]
    return b"".join(parts)


def test_times_are_utc_and_the_vehicle_is_the_autopilots() -> None:
    decoder = DataFlashDecoder()
    tables = decoder.feed(one_log(), final=True)
    assert decoder.vehicles == (7,)
    assert not decoder.undated
    rcou = tables["RCOU"]
    assert (rcou.time_us == BOOT_UTC_US + rcou["TimeUS"].astype(np.int64)).all()
    assert {*zip(rcou.system.tolist(), rcou.component.tolist(), rcou.sequence.tolist(), strict=True)} == {
        (7, 0, 0)
    }
    assert decoder.first_time_us == BOOT_UTC_US + 1000
    assert decoder.counts[7, 0, "RCOU"] == len(rcou) == 298
    assert (tables["FMT"].time_us == BOOT_UTC_US + 1000).all()


@pytest.mark.parametrize(("year_us", "leap_s"), [(1_470_000_000_000_000, 17), (1_430_000_000_000_000, 16)])
def test_leap_seconds_are_those_of_the_day(year_us: int, leap_s: int) -> None:
    decoder = DataFlashDecoder()
    decoder.feed(HEAD + rcou(5) * 3 + gps(10_000, boot_us=year_us, leap_s=leap_s) + rcou(10_500), final=True)
    assert decoder.first_time_us == year_us + 5


def test_a_log_without_a_fix_is_undated() -> None:
    decoder = DataFlashDecoder()
    decoder.feed(HEAD + rcou(5) * 3 + gps(10_000, status=1) + rcou(10_500), final=True)
    assert decoder.undated
    assert (decoder.first_time_us, decoder.last_time_us) == (5, 10_500)
    assert decoder.vehicles == (1,)


def test_what_is_recorded_beyond_a_megabyte_is_not_waited_for() -> None:
    filler = b"".join(rcou(10_000 * k) for k in range(60_000))
    late = DataFlashDecoder()
    late.feed(HEAD + filler + gps(600_000_000) + rcou(600_000_100), final=True)
    assert late.undated


TWO_LOGS = one_log(3) + one_log(4, boot_us=BOOT_UTC_US + 10**10)


@given(cuts(len(TWO_LOGS)))
@settings(max_examples=10, deadline=None)
def test_where_blocks_end_never_matters(places: list[int]) -> None:
    assert_cuts_do_not_matter(TWO_LOGS, places)


def test_several_logs_in_one_file_have_each_its_vehicle_and_its_date() -> None:
    later = BOOT_UTC_US + 10**10
    decoder = DataFlashDecoder()
    tables = decoder.feed(one_log(3) + one_log(4, boot_us=later), final=True)
    assert decoder.vehicles == (3, 4)
    second = tables["RCOU"].select(tables["RCOU"].system == 4)
    assert (second.time_us == later + second["TimeUS"].astype(np.int64)).all()
    assert decoder.losses.time_rewinds == 0
    assert not decoder.losses.any


def test_only_wanted_messages_are_unpacked_but_all_are_counted() -> None:
    decoder = Decoder({"RCOU", "ATTITUDE"})
    tables = decoder.feed(one_log(), final=True)
    assert set(tables) == {"RCOU"}
    assert decoder.counts[7, 0, "GPS"] == 1
    assert decoder.format == "dataflash"
    everything = Decoder().feed(one_log(), final=True)
    assert np.array_equal(tables["RCOU"].frame, everything["RCOU"].frame)


def test_what_the_logger_dropped_is_reported() -> None:
    data = HEAD + b"".join(of("DSF", 10_000 * k, drops) for k, drops in enumerate([0, 0, 3, 9]))
    decoder = Decoder({"RCOU"})
    assert decoder.feed(data, final=True) == {}
    assert decoder.losses.logger_dropped == 9


def test_a_letters_scale_applies_once() -> None:
    att = of("ATT", 1000, 150, -3512, 0, 35, 17999, 35999)
    position = of("GPS", 2000, 0, 1, 0, 0, -353632621, 1491652374, 58406)
    tables = DataFlashDecoder().feed(HEAD + att + position, final=True)
    assert tables["ATT"]["Roll"].tolist() == [-35.12]
    assert tables["ATT"].to_frame()["Yaw"].tolist() == [359.99]
    assert tables["GPS"]["Lat"].tolist() == [-35.3632621]
    assert tables["GPS"]["Alt"].tolist() == [584.06]
    assert tables["GPS"].fields["Alt"].tolist() == [58406]


def test_names_that_mean_two_things_are_unknown() -> None:
    twice = definition(20, "TWO", "QB", "TimeUS,A,A"[:8]) + definition(21, "DUP", "QBB", "TimeUS,A,A")
    clash = definition(22, "RCOU", "QB", "TimeUS,Other")
    rows = record(20, "QB", [1000, 1]) + record(21, "QBB", [1000, 1, 2]) + record(22, "QB", [1000, 3])
    decoder = DataFlashDecoder()
    tables = decoder.feed(HEAD + twice + clash + rows + rcou(2000), final=True)
    assert {"TWO", "RCOU"} <= set(tables)
    assert "DUP" not in tables
    assert len(tables["RCOU"]) == 1
    assert decoder.unknown == {21: 1, 22: 1}
    assert decoder.losses.unknown_frames == 2


def test_a_definition_of_another_length_than_its_fields_is_no_damage_unless_records_follow() -> None:
    """ArduCopter 3.4 defines EKF5 so, and never writes one."""
    slip = bytearray(definition(164, "EKF5", "QBhhhcccCCfff", "TimeUS,NI,FIX,FIY,AFI,HAGL"))
    slip[4] = 28
    log = one_log()
    defined = log.replace(HEAD, HEAD + bytes(slip))
    sound, found, damaged = DataFlashDecoder(), DataFlashDecoder(), DataFlashDecoder()
    tables = found.feed(defined, final=True)
    assert not found.losses.any
    assert "EKF5" not in tables
    assert [*tables] == [*sound.feed(log, final=True)]
    damaged.feed(defined + bytes([0xA3, 0x95, 164]) + bytes(25) + rcou(9_000_000), final=True)
    assert damaged.losses.any
