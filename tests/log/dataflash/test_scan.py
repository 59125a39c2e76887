"""Which records are found, whatever the bytes and wherever blocks end."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.log.damage import damage, damaged_bytes
from tests.log.dataflash.hostile import check
from tests.log.dataflash.kernel_check import checked, scan
from tests.log.dataflash.recovery import COUNTS, recover
from tests.log.dataflash.synthetic import FORMATS, definition, fmt_of_fmt, rcou, record, stream

LOG = b"".join(stream(5, 3000))
RCOU, LETTERS, _ = FORMATS["RCOU"]


HEAD = fmt_of_fmt() + definition(RCOU, "RCOU", *FORMATS["RCOU"][1:])


def test_every_record_of_a_sound_log_is_found() -> None:
    found, _ = checked(LOG)
    assert len(found) == len(stream(5, 3000))
    assert not any(record.odd_time for record in found)


@given(st.integers(0, 2**32), st.lists(st.integers(0, len(LOG)), max_size=6))
@settings(deadline=None, max_examples=25)
def test_where_blocks_end_never_matters(seed: int, places: list[int]) -> None:
    origin = damage(LOG, random.Random(seed).choice([*COUNTS]), 5, seed)
    data = damaged_bytes(LOG, origin)
    whole, scanner = scan(data)
    pieces, in_pieces = scan(data, [min(place, len(data)) for place in places])
    assert pieces == whole
    assert in_pieces.totals == scanner.totals
    assert in_pieces.regions == scanner.regions


def test_a_byte_at_a_time() -> None:
    data = LOG[:6000]
    assert scan(data, range(len(data)))[0] == scan(data)[0]


def test_hostile_mutations_are_accounted_for() -> None:
    check(600, seed=3)


@given(st.binary(max_size=400), st.booleans())
@settings(deadline=None, max_examples=60)
def test_noise_is_accounted_for(noise: bytes, headed: bool) -> None:
    checked((HEAD if headed else b"") + noise)


@pytest.mark.parametrize("kind", COUNTS)
def test_more_is_recovered_than_by_the_peers_and_less_is_false(kind: str) -> None:
    found = recover(LOG, kind, max(COUNTS[kind] // 20, 2), seed=1)
    slack = 3 if kind == "zeroed blocks" else 0  # a record that ends in zeros looks cut by zeros
    assert found.good >= found.trusting[0] - slack
    assert found.false <= found.trusting[1]
    assert found.good >= 0.99 * found.intact


def test_old_clusters_leave_nothing_behind() -> None:
    data = bytearray(LOG)
    size = 4096
    for block in (8, 14, 20):
        data[block * size : (block + 1) * size] = LOG[(block - 5) * size : (block - 4) * size]
    found, scanner = checked(bytes(data))
    times = np.array([record.time_us for record in found if record.time_us >= 0])
    assert (np.diff(times) > -1000).all()
    assert scanner.totals.old_records > 100
    assert scanner.totals.rewinds == 0


@pytest.mark.parametrize("wrong_us", [0, 7, 2_000_000, 10**9, 10**15, 2**52, 2**63 + 5])
def test_one_bad_stamp_costs_nothing(wrong_us: int) -> None:
    times = [10_000_000 + 10_000 * k for k in range(100)]
    times[50] = wrong_us
    found, _ = checked(HEAD + b"".join(map(rcou, times)))
    assert len(found) == 102
    odd = [record for record in found if record.odd_time]
    assert [record.time_us for record in odd] == [10_490_000]


def test_a_gap_is_a_gap() -> None:
    times = [*range(0, 10**6, 10**4), *range(700 * 10**6, 701 * 10**6, 10**4)]
    found, scanner = checked(HEAD + b"".join(map(rcou, times)))
    assert [record.time_us for record in found[2:]] == times
    assert (scanner.totals.jumps, scanner.totals.old_records, scanner.totals.odd_times) == (1, 0, 0)


def test_a_clock_that_was_set_back_for_good_is_believed_after_a_cluster() -> None:
    times = [*range(100 * 10**6, 110 * 10**6, 10**4), *range(0, 50 * 10**6, 10**4)]
    found, scanner = checked(HEAD + b"".join(map(rcou, times)))
    assert scanner.totals.rewinds == 1
    assert scanner.totals.old_records * len(rcou(0)) < 70_000
    assert found[-1].time_us == times[-1]


@pytest.mark.parametrize(
    ("step_us", "old", "jumps"),
    [(-100_000, 0, 0), (-100_001, 3, 0), (60_000_000, 0, 0), (60_000_001, 0, 1)],
)
def test_a_step_back_of_a_tenth_of_a_second_begins_an_old_cluster(step_us: int, old: int, jumps: int) -> None:
    times = [*range(10**8, 10**8 + 10**6, 10**4)]
    times += [times[-1] + step_us + 10 * k * (1 if step_us > 0 else -1) for k in range(3)]
    times += [times[99] + 10_000 * k for k in range(1, 4)] if step_us < 0 else []
    totals = checked(HEAD + b"".join(map(rcou, times)))[1].totals
    assert (totals.old_records, totals.jumps) == (old, jumps)


@pytest.mark.parametrize(
    ("between", "counts"),
    [
        (bytes(8), True),
        (bytes(7), False),
        (b"\xff" * 8, False),
        (b"\xa3\x94" + rcou(10**6 + 3)[2:], True),  # a magic with one bit flipped
        (b"\xa2\x94" + rcou(10**6 + 3)[2:], False),
    ],
)
def test_a_gap_confirms_the_record_before_it_if_it_begins_there(between: bytes, counts: bool) -> None:
    last = record(RCOU, LETTERS, [10**6 + 2, 1000, 1500, 1500, 0x0101])
    data = HEAD + rcou(10**6) + last + between + rcou(10**6 + 4) * 2
    assert len(data[: data.index(last)] + last) % 100, "no border of a lost block"
    assert len(checked(data)[0]) == 2 + 1 + counts + 2


@pytest.mark.parametrize(("count", "last"), [(4095, True), (4096, False)])
def test_one_byte_repeated_to_the_end_confirms_the_last_record(count: int, last: bool) -> None:
    assert len(checked(HEAD + rcou(10**6) * 3 + b"\x07" * count)[0]) == 2 + 2 + last


def test_a_log_behind_another_begins_anew() -> None:
    second = b"".join(stream(6, 500, start_us=50_000))
    found, _ = checked(LOG + second)
    assert [found[0].boot, found[-1].boot] == [0, 1]
    assert len([record for record in found if record.boot == 1]) == 500


def test_a_type_may_be_defined_anew_by_another_log_alone() -> None:
    other = definition(RCOU, "RCOU", "QB", "TimeUS,C1")
    data = HEAD + rcou(10**6) * 3 + other + rcou(10**6) * 3
    assert [found.payload for found in checked(data)[0]][2:] == [rcou(10**6)[3:]] * 6
    second = fmt_of_fmt() + other + record(RCOU, "QB", [5, 1]) * 3
    found, _ = checked(HEAD + rcou(10**6) * 3 + second)
    assert [len(record.payload) for record in found[-3:]] == [9, 9, 9]


@pytest.mark.parametrize(
    ("place", "written", "counts", "defines"),
    [
        (5, b"RCOU", True, True),
        (5, b"\x07COU", False, False),
        (5, b"R\0OU", False, False),
        (5, bytes(4), False, False),
        (9, b"y", False, False),  # no such type of field
        (9 + 6, b"B", False, False),
        (25, b"\x1f", False, False),
        (25, bytes(64), False, False),
        (4, bytes([3]), False, False),
        (4, bytes([99]), True, False),  # not the length of its fields: it defines nothing
    ],
)
def test_a_definition_is_plausible_in_itself(place: int, written: bytes, counts: bool, defines: bool) -> None:
    definition = bytearray(HEAD[len(fmt_of_fmt()) :])
    definition[place : place + len(written)] = written
    found, _ = checked(fmt_of_fmt() + bytes(definition) + rcou(10**6) * 2)
    assert len(found) == 1 + counts + 2 * defines


def test_the_end_of_a_block_flash_is_filler() -> None:
    data = HEAD + rcou(10**6) * 3
    for rest, filler, cut_end in ((b"\xff" * 249, 249, 0), (rcou(10**6)[:9], 0, 9)):
        totals = scan(data + rest)[1].totals
        assert (totals.filler, totals.skipped, totals.cut_end) == (filler, 0, cut_end)


@pytest.mark.parametrize("border", [512, 200])
def test_a_record_that_ends_at_the_border_of_a_lost_block_counts(border: int) -> None:
    count = next(n for n in range(1, 600) if (len(HEAD) + n * len(rcou(0))) % border == 0)
    whole = HEAD + b"".join(rcou(10**6 + 1000 * k) for k in range(count))
    lost = random.Random(1).randbytes(512) if border == 512 else bytes(200)
    found, _ = checked(whole + lost + rcou(10**6 + 1000 * count) * 2)
    assert len(found) == 2 + count + 2
    noise = random.Random(2).randbytes(512)
    found, _ = checked(whole[: -len(rcou(0))] + noise + rcou(10**6 + 1000 * count) * 2)
    assert len(found) == 2 + count - 2 + 2, "elsewhere nobody knows where the damage began"
