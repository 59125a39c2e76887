"""Every value is DFReader's: on logs that others recorded, and on made ones of every field type."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mavhums.core.errors import UnreadableLogError
from mavhums.log import read_log
from tests.conftest import carried_logs, real_logs
from tests.log.dataflash.peer import by_dfreader, differing_columns
from tests.log.dataflash.synthetic import CODES, definition, fmt_of_fmt, record

LOGS = [path for path in (*carried_logs(), *real_logs()) if path.suffix.lower() == ".bin"]
TOO_OLD = "log171.bin"

LETTERS = "abBhHiIfdgnNZcCeELMqQ"
RANGES = {
    code: (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if code.islower() else (0, 2**bits - 1)
    for code, bits in zip("bBhHiIqQ", (8, 8, 16, 16, 32, 32, 64, 64), strict=True)
}
_WIDTHS = {"f": 32, "d": 64, "e": 16}
_TEXT = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E))


def _value(letter: str) -> st.SearchStrategy[object]:
    code = CODES[letter]
    if letter == "a":
        return st.lists(st.integers(-(2**15), 2**15 - 1), min_size=32, max_size=32)
    if code.endswith("s"):
        return _TEXT.map(lambda text: text[: int(code[:-1])].encode())
    if code in _WIDTHS:
        return st.floats(width=_WIDTHS[code])  # type: ignore[arg-type]
    if letter == "M":
        return st.integers(0, 127)  # above, see below
    low, high = RANGES[code]
    return st.integers(low, high)


@st.composite
def logs(draw: st.DrawFn) -> bytes:
    """A log of three messages with fields of any type, each the first three times."""
    head, rows = [fmt_of_fmt()], list[bytes]()
    for k in range(3):
        letters = "Q" + draw(st.text(LETTERS.replace("a", ""), min_size=1, max_size=11))
        letters += "a" if k == 2 else ""
        columns = ",".join(["TimeUS", *(f"F{n}" for n in range(len(letters) - 1))])
        if 3 + sum(struct.calcsize("<" + CODES[c]) for c in letters) > 255:
            letters, columns = "QB", "TimeUS,F0"
        head.append(definition(k, f"M{k}", letters, columns))
        for _ in range(draw(st.integers(1, 4))):
            values = [1000 * len(rows), *(draw(_value(letter)) for letter in letters[1:])]
            rows.append(record(k, letters, values))
    return b"".join(head + rows)


@pytest.mark.slow
@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.name)
def test_every_value_of_a_real_log(path: Path) -> None:
    if path.name == TOO_OLD:
        with pytest.raises(UnreadableLogError, match="TimeUS"):
            read_log(path)
        return
    log = read_log(path)
    assert differing_columns(log.tables, by_dfreader(path)) == []
    assert log.losses.bytes_skipped == log.losses.implausible_times == 0


def test_every_value_of_the_smallest_real_log() -> None:
    path = min((path for path in LOGS if path.name != TOO_OLD), key=lambda path: path.stat().st_size)
    assert differing_columns(read_log(path).tables, by_dfreader(path)) == []


@given(logs())
@settings(deadline=None, max_examples=40, suppress_health_check=list(HealthCheck))
def test_every_field_type(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "made.bin"
    path.write_bytes(data)
    log = read_log(path)
    assert not log.losses.any
    assert differing_columns(log.tables, by_dfreader(path)) == []


def test_a_flight_mode_above_127_is_no_negative_number(tmp_path: Path) -> None:
    path = tmp_path / "mode.bin"
    mode = definition(5, "MODE", "QM", "TimeUS,Mode")
    path.write_bytes(fmt_of_fmt() + mode + record(5, "QM", [1000, 200]))
    assert by_dfreader(path)["MODE"][1] == [[1000, -56]]
    assert read_log(path).tables["MODE"]["Mode"].tolist() == [200]  # ArduPilot's is a uint8_t
