"""The operator's table: what it says, and what it refuses."""

from __future__ import annotations

from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums.flights.aircraft import AircraftTableError, Installation, load_aircraft_table

CSV = """\
aircraft, board, actuator, serial, from, to
D-EABC,0a1b,,,,2026-03-01
D-EXYZ,0A1B,,,2026-03-01,

D-EABC,,elevator,EMA-1,,2026-02-10
D-EABC,,elevator,EMA-2,2026-02-10T12:00:00+02:00,
D-EABC,,rudder,EMA-3,2026-01-05,2026-04-01
"""


def day(month: int, number: int, hour: int = 0) -> datetime:
    return datetime(2026, month, number, hour, tzinfo=UTC)


@pytest.mark.parametrize("text", [CSV, f"\ufeff{CSV}"])
def test_the_table_dates_boards_and_actuators(tmp_path: Path, text: str) -> None:
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    table = load_aircraft_table(tmp_path / "t.csv")
    assert table.aircraft_of("0A1B", day(2, 28)) == "D-EABC"
    assert table.aircraft_of("0A1B", day(3, 1)) == "D-EXYZ"
    assert table.aircraft_of("0C", day(3, 1)) is table.aircraft_of(None, day(3, 1)) is None
    assert table.since("D-EABC", day(1, 1)) == {}
    assert table.since("D-EABC", day(2, 10, 11)) == {"elevator": day(2, 10, 10), "rudder": day(1, 5)}
    assert table.since("D-EABC", day(5, 1))["rudder"] == day(4, 1)  # taken out: what came is unknown
    assert table.since("D-EXYZ", day(5, 1)) == table.since(None, day(5, 1)) == {}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "aircraft"),
        ("aircraft,bord\nA,1\n", "'bord'"),
        ("aircraft,bord,form\nA,1,2\n", "'bord'"),
        (f"aircraft,{'b' * 41}\nA,1\n", f"unknown column '{'b' * 40}'"),
        ("aircraft,board,from\n,1,yesterday\n", ":2: aircraft"),
        ("aircraft,board\nA,1,2\n", ":2: has more fields"),
        ("aircraft,board\n,1\n", ":2: aircraft"),
        ("aircraft,board\nA,\n", ":2: name a board, or an actuator"),
        ("aircraft,board,actuator,serial\nA,1,rudder,2\n", ":2: name a board, or an actuator"),
        ("aircraft,actuator\nA,rudder\n", ":2: name a board, or an actuator"),
        ("aircraft,board,from\nA,1,yesterday\n", ":2: from"),
        ("aircraft,board,from,to\nA,1,2026-02-01,2026-02-01\n", ":2: the date 'to' must be after"),
        ("aircraft,board\nA,1\nB,2\nC,1\n", ":4: the board is also installed by"),
        ("aircraft,board,from,to\nA,1,,2026-02-01\nB,1,2026-01-31,\n", ":3: the board is also"),
        ("aircraft,actuator,serial\nA,rudder,1\nA,rudder,2\n", ":3: the actuator is also installed"),
        ("aircraft,actuator,serial\nA,rudder,1\nB,rudder,1\n", ":3: the serial number is also"),
        ('aircraft,board\n"A,1', "is not valid CSV"),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(AircraftTableError) as error:
        load_aircraft_table(path)
    assert str(path) in error.value.problem
    assert problem in error.value.problem
    assert error.value.remedy


@given(data=st.binary(max_size=200) | st.text(alphabet='aircrftbod,\n"1-2026', max_size=200).map(str.encode))
def test_any_file_is_a_table_or_refused(data: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(data)
    with suppress(AircraftTableError):
        assert load_aircraft_table(path).installed is not None


def test_a_missing_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(AircraftTableError, match=r"none\.csv: no such file"):
        load_aircraft_table(tmp_path / "none.csv")


spans = st.tuples(st.none() | st.integers(1, 9), st.none() | st.integers(10, 12)) | st.tuples(
    st.integers(1, 4), st.integers(5, 8)
)


@given(first=spans, second=spans)
def test_an_entry_holds_from_its_first_day_to_before_its_last(
    first: tuple[int | None, int | None], second: tuple[int | None, int | None]
) -> None:
    whose = {"aircraft": "A", "board": "1"}
    dates = [dict(zip(("from", "to"), days, strict=True)) for days in (first, second)]
    each = [{name: day(1, n) for name, n in said.items() if n} for said in dates]
    entries = [Installation.model_validate(whose | said) for said in each]
    inside = [{n for n in range(1, 14) if entry.at(day(1, n))} for entry in entries]
    assert inside == [{*range(begins or 1, ends or 14)} for begins, ends in (first, second)]
    one, other = entries
    assert one.overlaps(other) is other.overlaps(one) is bool(inside[0] & inside[1])
