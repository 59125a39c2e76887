"""Every value is pyulog's, on the real logs and on logs with fields of every type."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.conftest import real_logs
from tests.log.decode import decode
from tests.log.ulog import writer
from tests.log.ulog.peer import columns_of_ours, columns_of_peer, differences, pyulog_reads

ULOGS = [path for path in real_logs() if path.suffix == ".ulg"]
TYPES = {f"{sign}int{8 * size}_t": size for sign in ("", "u") for size in (1, 2, 4, 8)}
TYPES |= {"float": 4, "double": 8, "bool": 1, "char": 1}
Field = tuple[str, int | None]


@pytest.mark.parametrize("path", ULOGS, ids=lambda path: path.stem)
def test_real_logs_have_the_values_of_pyulog(path: Path) -> None:
    log = path.read_bytes()
    tables, decoder = decode(log)
    peer = pyulog_reads(log)
    assert differences(columns_of_ours(tables), columns_of_peer(log)) == []
    assert decoder.losses.logger_dropped == len(peer.dropouts)
    assert not decoder.losses.any
    assert not decoder.unknown
    said = tables["parameter"]
    known = dict(zip(said.to_frame()["name"].tolist(), said["value"].tolist(), strict=True))
    changed = {name: value for _, name, value in peer.changed_parameters}
    assert known == pytest.approx(dict(peer.initial_parameters) | changed, rel=0, nan_ok=True)
    strings = tables.get("logged_string")
    told = [] if strings is None else strings.to_frame()["text"].tolist()
    tagged = [text for texts in peer.logged_messages_tagged.values() for text in texts]
    assert sorted(told) == sorted(text.message for text in [*peer.logged_messages, *tagged])


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
@given(
    inner=fields.map(lambda layout: [(k, n) for k, n in layout if k != "inner"] or [("bool", None)]),
    outer=fields,
    padding=st.integers(0, 7),
    instances=st.lists(st.integers(0, 255), min_size=1, max_size=3, unique=True),
    rows=st.integers(1, 6),
    seed=st.integers(0, 2**32 - 1),
    cut=st.floats(0, 1),
)
def test_made_logs_have_the_values_of_pyulog(
    inner: list[Field],
    outer: list[Field],
    padding: int,
    instances: list[int],
    rows: int,
    seed: int,
    cut: float,
) -> None:
    rng = np.random.default_rng(seed)
    size = size_of(outer, size_of(inner, 0))
    tail = f"uint8_t[{padding}] _padding0;" if padding else ""
    parts = [
        writer.header(),
        writer.form("topic", f"uint64_t timestamp;{text_of(outer)}{tail}"),
        writer.form("inner", text_of(inner)),
        *(writer.subscribe(10 + k, "topic", instance) for k, instance in enumerate(instances)),
    ]
    for k in range(rows):
        record = struct.pack("<Q", 1_000_000 + k) + rng.bytes(size)
        parts.append(writer.data(10 + k % len(instances), record))
    log = b"".join(parts)
    tables, decoder = decode(log, (int(cut * (len(log) - 1)),))
    assert differences(columns_of_ours(tables), columns_of_peer(log)) == []
    assert not decoder.losses.any


@settings(max_examples=60, deadline=None)
@given(
    parameters=st.dictionaries(
        st.from_regex(r"[A-Z][A-Z0-9_]{0,15}", fullmatch=True),
        st.integers(-(2**31), 2**31 - 1) | st.floats(width=32, allow_nan=False),
        min_size=1,
        max_size=8,
    ),
    texts=st.lists(
        st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=100).map(str.rstrip), max_size=5
    ),
    tag=st.none() | st.integers(0, 65535),
)
def test_parameters_and_texts_are_those_of_pyulog(
    parameters: dict[str, float], texts: list[str], tag: int | None
) -> None:
    log = writer.header() + b"".join(writer.parameter(name, value) for name, value in parameters.items())
    log += b"".join(writer.text(said, 1_000_000 + k, k % 8, tag) for k, said in enumerate(texts))
    tables, _ = decode(log)
    peer = pyulog_reads(log)
    said = tables["parameter"]
    assert (
        dict(zip(said.to_frame()["name"].tolist(), said["value"].tolist(), strict=True))
        == peer.initial_parameters
    )
    tagged = [text for texts in peer.logged_messages_tagged.values() for text in texts]
    strings = [(t.message, t.timestamp, t.log_level - 48) for t in [*peer.logged_messages, *tagged]]
    ours = tables.get("logged_string")
    if ours is None:
        assert strings == []
    else:
        columns = ours.to_frame()["text"].tolist(), ours["timestamp"].tolist(), ours["level"].tolist()
        assert list(zip(*columns, strict=True)) == strings
