"""Tables as pandas and CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums.log import Table, read_log
from mavhums.log.base.decoder import _as_text, text_of


@pytest.fixture(scope="module")
def table(short_log: Path) -> Table:
    return read_log(short_log, messages=["DEBUG_FLOAT_ARRAY"]).tables["DEBUG_FLOAT_ARRAY"]


def test_to_frame_has_every_field_as_contiguous_columns(table: Table) -> None:
    frame = table.to_frame()
    assert len(frame) == len(table)
    assert set(frame["name"]) == {"EMA"}
    for k in (0, 11, 57):
        assert np.array_equal(frame[f"data[{k}]"], table["data"][:, k], equal_nan=True)
    assert frame.dtypes["array_id"] == np.uint16
    assert np.array_equal(frame.index.to_numpy("M8[us]").astype(np.int64), table.time_us)


@given(
    st.lists(st.sampled_from([b"", b"a", b"a\0b", b"\xff\xfe", b"S1V05", b"SERVO1_MIN", b"Mission: 3 WP"]))
)
def test_texts_are_cut_at_the_first_zero_and_read_as_utf_8(texts: list[bytes]) -> None:
    chars = np.array(texts, dtype="S13")
    assert list(_as_text(chars)) == [text_of(value) for value in texts]


def test_frames_are_made_when_they_are_read(short_log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = read_log(short_log)
    made: list[str] = []

    def frame(table: Table) -> pd.DataFrame:
        made.append(table.name)
        return pd.DataFrame()

    monkeypatch.setattr(Table, "to_frame", frame)
    assert set(log.messages) == set(log.tables)
    assert not made
    assert log.messages["HEARTBEAT"] is log.messages["HEARTBEAT"]
    assert made == ["HEARTBEAT"]
