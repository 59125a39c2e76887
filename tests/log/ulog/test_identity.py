"""Every value is pyulog's, on the real logs and on logs with fields of every type."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import pyulog
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mavhums.log import Table
from tests.conftest import real_logs
from tests.log.decode import decode
from tests.log.ulog import writer
from tests.log.ulog.peer import columns_of_ours, columns_of_peer, differences, pyulog_reads

ULOGS = [path for path in real_logs() if path.suffix == ".ulg"]
TYPES = {f"{sign}int{8 * size}_t": size for sign in ("", "u") for size in (1, 2, 4, 8)}
TYPES |= {"float": 4, "double": 8, "bool": 1, "char": 1}
Field = tuple[str, int | None]


def said(tables: dict[str, Table], name: str, *columns: str) -> list[tuple[Any, ...]]:
    """Return the rows of a table as Python's values; none if the log has none."""
    frame = tables[name].to_frame() if name in tables else {column: pd.Series() for column in columns}
    return [*zip(*(frame[column].tolist() for column in columns), strict=True)]


def strings_of(peer: pyulog.ULog) -> list[tuple[str, int, int]]:
    tagged = [text for texts in peer.logged_messages_tagged.values() for text in texts]
    return [(one.message, one.timestamp, one.log_level - 48) for one in [*peer.logged_messages, *tagged]]


STRING = ("logged_string", "text", "timestamp", "level")


@pytest.mark.parametrize("path", ULOGS, ids=lambda path: path.stem)
def test_real_logs_have_the_values_of_pyulog(path: Path) -> None:
    log = path.read_bytes()
    (tables, decoder), peer = decode(log), pyulog_reads(log)
    assert differences(columns_of_ours(tables), columns_of_peer(log)) == []
    assert decoder.losses.logger_dropped == len(peer.dropouts)
    assert not decoder.losses.any
    assert not decoder.unknown
    changed = {name: value for _, name, value in peer.changed_parameters}
    known = dict(said(tables, "parameter", "name", "value"))
    assert known == pytest.approx(dict(peer.initial_parameters) | changed, rel=0, nan_ok=True)
    assert sorted(said(tables, *STRING)) == sorted(strings_of(peer))


fields = st.lists(
    st.tuples(st.sampled_from([*TYPES, "inner"]), st.none() | st.integers(1, 5)), min_size=1, max_size=6
)


def size_of(layout: list[Field], inner: int) -> int:
    return sum((inner if kind == "inner" else TYPES[kind]) * (count or 1) for kind, count in layout)


def text_of(layout: list[Field]) -> str:
    return "".join(
        f"{kind}{'' if count is None else f'[{count}]'} field_{k};" for k, (kind, count) in enumerate(layout)
    )


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_made_logs_have_the_values_of_pyulog(data: st.DataObject) -> None:
    inner = [(k, n) for k, n in data.draw(fields) if k != "inner"] or [("bool", None)]
    outer, padding = data.draw(fields), data.draw(st.integers(0, 7))
    instances = data.draw(st.lists(st.integers(0, 255), min_size=1, max_size=3, unique=True))
    rng, size = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1))), size_of(outer, size_of(inner, 0))
    tail = f"uint8_t[{padding}] _padding0;" if padding else ""
    parts = [writer.header(), writer.form("topic", f"uint64_t timestamp;{text_of(outer)}{tail}")]
    parts.append(writer.form("inner", text_of(inner)))
    parts += [writer.subscribe(10 + k, "topic", instance) for k, instance in enumerate(instances)]
    for k in range(data.draw(st.integers(1, 6))):
        record = struct.pack("<Q", 1_000_000 + k) + rng.bytes(size)
        parts.append(writer.data(10 + k % len(instances), record))
    log = b"".join(parts)
    tables, decoder = decode(log, [data.draw(st.integers(0, len(log) - 1))])
    assert differences(columns_of_ours(tables), columns_of_peer(log)) == []
    assert not decoder.losses.any


NAMES = st.from_regex(r"[A-Z][A-Z0-9_]{0,15}", fullmatch=True)
VALUES = st.integers(-(2**31), 2**31 - 1) | st.floats(width=32, allow_nan=False)
TEXTS = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=100).map(str.rstrip)


@settings(max_examples=60, deadline=None)
@given(
    st.dictionaries(NAMES, VALUES, min_size=1, max_size=8),
    st.lists(TEXTS, max_size=5),
    st.none() | st.integers(0, 65535),
)
def test_parameters_and_texts_are_those_of_pyulog(
    parameters: dict[str, float], texts: list[str], tag: int | None
) -> None:
    log = writer.header() + b"".join(writer.parameter(name, value) for name, value in parameters.items())
    log += b"".join(writer.text(text, 1_000_000 + k, k % 8, tag) for k, text in enumerate(texts))
    (tables, _), peer = decode(log), pyulog_reads(log)
    assert dict(said(tables, "parameter", "name", "value")) == peer.initial_parameters
    assert said(tables, *STRING) == strings_of(peer)
