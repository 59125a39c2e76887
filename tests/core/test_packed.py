"""Compressed and archived files are read as what is in them, or refused with a word that helps."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import os
import socket
import sys
import threading
import tracemalloc
import zipfile
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import zstandard

from mavhums import analyse, read_log
from mavhums.core.errors import UnreadableLogError
from mavhums.core.packed import SequentialFile, members, opened
from tests.log.ulog import writer

LOG = writer.flight(2.0)


def zipped(path: Path, *members: tuple[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members:
            archive.writestr(name, data)
    return path


COMPRESSORS: dict[str, Callable[[bytes], bytes]] = {
    "gz": gzip.compress,
    "zst": zstandard.compress,
    "xz": lzma.compress,
    "bz2": bz2.compress,
}
COMPRESSED = {f"flight.ulg.{suffix}": compress(LOG) for suffix, compress in COMPRESSORS.items()}
COMPRESSED["no suffix"] = gzip.compress(LOG)
for _suffix, _compress in COMPRESSORS.items():
    COMPRESSED[f"two streams.{_suffix}"] = _compress(LOG[:1000]) + bytes(5000) + _compress(LOG[1000:])
ARCHIVED = {
    "one.zip": (("a/", b""), ("a/flight.ulg", LOG), ("__MACOSX/a", b"x")),
    "inner.zip": (("flight.ulg.gz", gzip.compress(LOG)),),
    "several.zip": (("flight.ulg", LOG), ("notes.txt", b"windy")),
}


@pytest.mark.parametrize("name", [*COMPRESSED, *ARCHIVED])
def test_what_is_packed_is_read_as_the_log_in_it(name: str, tmp_path: Path) -> None:
    plain = tmp_path / "plain.ulg"
    plain.write_bytes(LOG)
    path = tmp_path / name
    if name in COMPRESSED:
        path.write_bytes(COMPRESSED[name])
    else:
        path = zipped(path, *ARCHIVED[name]) / ("flight.ulg" if name == "several.zip" else "")
    log = read_log(path)
    assert log.format == "ulog"
    assert log.counts == read_log(plain).counts
    assert analyse(path).log.sha256 == analyse(plain).log.sha256


@pytest.mark.parametrize(("inner", "outer"), list(product(COMPRESSORS.values(), repeat=2)))
def test_what_is_packed_twice_is_read(inner: Any, outer: Any, tmp_path: Path) -> None:
    path = tmp_path / "twice"
    path.write_bytes(outer(inner(LOG)))
    with opened(path) as file:
        assert file.read(len(LOG) + 1) == LOG


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("bad.zip", "damaged or cut"),
        ("several.zip", "contains 2 files: a.ulg, b.ulg: name one, for example .*several.zip/a.ulg"),
        ("several.zip/c.ulg", "no such member: it holds a.ulg, b.ulg"),
        ("empty.zip", "contains no file"),
        ("flight.ulg/member", "is a file, not a zip archive"),
        ("outer.zip", "this is a zip archive"),
    ],
)
def test_what_cannot_be_read_is_reported(name: str, said: str, tmp_path: Path) -> None:
    several = zipped(tmp_path / "several.zip", ("a.ulg", LOG), ("b.ulg", LOG)).read_bytes()
    (tmp_path / "bad.zip").write_bytes(several.replace(b"PK\x01\x02", b"PK\x01\x03"))
    (tmp_path / "flight.ulg").write_bytes(LOG)
    zipped(tmp_path / "empty.zip", ("a/", b""))
    zipped(tmp_path / "outer.zip", ("several.zip", several))
    with pytest.raises(UnreadableLogError, match=said):
        read_log(tmp_path / name)


def drain(file: SequentialFile) -> None:
    while file.read(1 << 16):
        pass


@pytest.mark.slow
@pytest.mark.parametrize("suffix", COMPRESSORS)
def test_a_bomb_is_stopped_and_needs_no_memory(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SequentialFile, "free", 1 << 20)
    path = tmp_path / "bomb"
    path.write_bytes(COMPRESSORS[suffix](bytes(256 << 20)))
    tracemalloc.start()
    with opened(path) as file, pytest.raises(UnreadableLogError, match="expands to more than 200 times"):
        drain(file)
    assert tracemalloc.get_traced_memory()[1] < 80 << 20
    tracemalloc.stop()


def test_zeros_that_a_card_left_are_no_bomb(tmp_path: Path) -> None:
    path = tmp_path / "zeros.gz"
    path.write_bytes(gzip.compress(LOG + bytes(20 << 20)))
    assert read_log(path).losses.trailing_zeros >= 20 << 20


@pytest.mark.skipif(sys.platform == "win32", reason="files of POSIX")
@pytest.mark.parametrize("kind", ["pipe", "zipped pipe", "device", "socket"])
@pytest.mark.parametrize("writers", [0, 1])
def test_what_may_never_end_is_refused_at_once(kind: str, writers: int, tmp_path: Path) -> None:
    path = Path("/dev/zero") if kind == "device" else tmp_path / ("a.zip" if "zip" in kind else "a.tlog")
    open_ends = []
    if "pipe" in kind:
        os.mkfifo(path)
        reading = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        open_ends = [os.open(path, os.O_WRONLY) for _ in range(writers)]
        os.close(reading)
    listening = socket.socket(socket.AF_UNIX)
    if kind == "socket":
        listening.bind(str(path))

    def attempt() -> None:
        with pytest.raises(UnreadableLogError, match="is a pipe, a device or a socket"):
            members(path) if "zip" in kind else read_log(path)
        done.set()

    done = threading.Event()
    threading.Thread(target=attempt, daemon=True).start()
    assert done.wait(10)
    for end in open_ends:
        os.close(end)
    listening.close()


@pytest.mark.skipif(not Path("/dev/fd/0").exists(), reason="descriptors have no paths")
def test_a_pipe_that_the_caller_opened_is_read(tmp_path: Path) -> None:
    """As ``<(...)`` of a shell; that its writer has ended before does not matter."""
    reading, writing = os.pipe()
    os.write(writing, LOG[:60_000])
    os.close(writing)
    assert read_log(f"/dev/fd/{reading}").format == "ulog"
    os.close(reading)


def test_the_standard_input_may_be_compressed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(gzip.compress(LOG))))
    assert read_log("-").format == "ulog"


@pytest.mark.parametrize("compress", COMPRESSORS.values())
def test_a_cut_or_damaged_stream_is_reported(compress: Any, tmp_path: Path) -> None:
    whole = compress(LOG)
    damaged = bytearray(whole)
    damaged[len(whole) // 2] ^= 0xFF
    for name, data in (("cut", whole[:-20]), ("damaged", bytes(damaged))):
        if name == "damaged" and compress is zstandard.compress:
            continue  # its frames have no checksum here
        (tmp_path / name).write_bytes(data)
        with pytest.raises(UnreadableLogError, match="damaged or cut"), opened(tmp_path / name) as file:
            drain(file)


@pytest.mark.slow
def test_an_xz_stream_that_wants_much_memory_is_refused(tmp_path: Path) -> None:
    filters = [{"id": lzma.FILTER_LZMA2, "preset": 1, "dict_size": 1 << 29}]
    (tmp_path / "greedy.xz").write_bytes(lzma.compress(LOG, filters=filters))
    with pytest.raises(UnreadableLogError, match="damaged or cut"), opened(tmp_path / "greedy.xz") as file:
        drain(file)
