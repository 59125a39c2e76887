"""Uploads: bounded in size and time, and never outside their folder."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import AsyncIterator, Callable
from pathlib import Path, PurePosixPath, PureWindowsPath

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums import fleet
from mavhums.app.settings import Options
from mavhums.core.errors import MavhumsError
from mavhums.serve.uploads import Quotas, keep, receive, safe_name

SMALL = Quotas(log_bytes=1000, upload_s=0.1)


def test_names_keep_what_a_user_reads() -> None:
    assert safe_name("2026-03-01 flight (1).tlog") == "2026-03-01 flight (1).tlog"
    assert safe_name("Flügel_左.BIN") == "Flügel_左.BIN"
    assert safe_name("") == safe_name("...") == safe_name("/") == "log"
    assert safe_name("a" * 500 + ".tlog").endswith("aaa.tlog")
    assert safe_name("a\x00b\x1b[31m\n.ulg") == "a_b_[31m_.ulg"


@given(st.text(max_size=400) | st.text("./\\:\x00ab", max_size=50))
def test_no_name_leaves_its_folder(name: str) -> None:
    safe = safe_name(name)
    assert safe not in ("", ".", "..")
    assert PurePosixPath(safe).name == PureWindowsPath(safe).name == safe
    assert len(safe.encode()) <= 150
    assert safe.isprintable()


async def parts(*sizes: int, wait_s: float = 0.0) -> AsyncIterator[bytes]:
    for size in sizes:
        await asyncio.sleep(wait_s)
        yield b"x" * size


def test_an_upload_arrives_whole(tmp_path: Path) -> None:
    assert asyncio.run(receive(parts(500, 500), tmp_path / "a", SMALL)) == 1000
    assert (tmp_path / "a").read_bytes() == b"x" * 1000


@pytest.mark.parametrize(
    ("stream", "problem"),
    [
        (lambda: parts(600, 600), "larger than 0 MB"),
        (parts, "the file is empty"),
        (lambda: parts(1, 1, wait_s=0.2), "took too long"),
        (lambda: parts(*[1] * 500, wait_s=0.01), "took too long"),
    ],
)
def test_a_refused_upload_leaves_nothing(
    tmp_path: Path, stream: Callable[[], AsyncIterator[bytes]], problem: str
) -> None:
    with pytest.raises(MavhumsError, match=problem) as caught:
        asyncio.run(receive(stream(), tmp_path / "a", SMALL))
    assert caught.value.remedy
    assert not list(tmp_path.iterdir())


def test_an_upload_replaces_nothing(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"before")
    with pytest.raises(MavhumsError, match="cannot be stored"):
        asyncio.run(receive(parts(1), tmp_path / "a", SMALL))


def test_a_log_is_kept_once_and_beside_its_store(healthy_log: Path, tmp_path: Path) -> None:
    options = Options(store=tmp_path / "store")
    first, again, noise = (tmp_path / name for name in ("a.tlog", "b.tlog", "noise.tlog"))
    for log in (first, again):
        shutil.copy(healthy_log, log)
    noise.write_bytes(b"no log" * 999)
    assert keep(options, first, "D-A") == "kept in the store as a.tlog; see the fleet"
    assert keep(options, again, "D-A") == "the store has this log already; see the fleet"
    with pytest.raises(MavhumsError, match=r"noise\.tlog") as caught:
        keep(options, noise, "D-A")
    assert str(tmp_path) not in f"{caught.value}"
    assert [copy.name for copy in (tmp_path / "store.logs").rglob("*.tlog")] == ["a.tlog"]
    assert {each.aircraft for each in fleet.worst(tmp_path / "store")} == {"D-A"}
    with pytest.raises(MavhumsError, match="a store at an address has no folder"):
        keep(Options(store="postgresql://nobody@localhost/none"), first)
