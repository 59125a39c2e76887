"""An archive on the page: each log in it is judged, and what is no log is named."""

from __future__ import annotations

import asyncio
import gzip
import io
import zipfile
from pathlib import Path

import pytest

from mavhums.app.settings import Options
from mavhums.core.errors import MavhumsError
from mavhums.serve.sessions import Sessions, UserSession
from mavhums.serve.uploads import Quotas, take_logs
from mavhums.serve.workers import Workers
from tests.present import present
from tests.serve.test_sessions import content, settled


def archive(path: Path, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(name, data)
    return path


@pytest.fixture
def mixed(short_log: Path, tmp_path: Path) -> Path:
    log = short_log.read_bytes()
    others = {"notes.txt": b"windy", "/etc/hostname": log, "../up.tlog": log}
    return archive(
        tmp_path / "flights.zip", **others, **{"a/one.tlog": log, "two.tlog.gz": gzip.compress(log)}
    )


def test_logs_are_taken_and_the_rest_is_named(mixed: Path, short_log: Path, tmp_path: Path) -> None:
    taken = present(take_logs(mixed, tmp_path / "out", 1 << 30, 10))
    assert [path.name for path in taken.logs] == ["one.tlog", "two.tlog"]
    assert {path.read_bytes() for path in taken.logs} == {short_log.read_bytes()}
    assert sorted(taken.others) == ["../up.tlog", "/etc/hostname", "notes.txt"], (
        "names that leave the archive"
    )
    assert all(path.is_relative_to(tmp_path / "out") for path in (tmp_path / "out").rglob("*"))
    few = present(take_logs(mixed, tmp_path / "few", 1 << 30, 1))
    assert len(few.logs) == 1
    assert "two.tlog.gz" in few.others
    with pytest.raises(MavhumsError, match="larger than"):
        take_logs(mixed, tmp_path / "large", len(short_log.read_bytes()) + 1, 10)


def test_an_archive_of_one_file_is_judged_as_that(short_log: Path, tmp_path: Path) -> None:
    path = archive(tmp_path / "one.zip", **{"x.tlog": short_log.read_bytes()})
    assert take_logs(path, tmp_path / "out", 1 << 30, 10) is None


@pytest.mark.slow
def test_the_page_judges_each_log_of_an_archive(mixed: Path, tmp_path: Path) -> None:
    useless = io.BytesIO()
    with zipfile.ZipFile(useless, "w") as file:
        file.writestr("a.txt", b"a")
        file.writestr("b.txt", b"b")

    async def whole() -> UserSession:
        workers = Workers(Quotas(workers=1))
        workers.start()
        sessions = Sessions(Quotas(), Options(airframe="paper"), workers)
        try:
            await sessions.add("a", "flights.zip", content(mixed.read_bytes()))
            session = sessions.get("a")
            await sessions.add("a", "texts.zip", content(useless.getvalue()))
            await settled(session)
            assert all(log.report.is_file() for log in session.logs.values() if log.state == "done")
            return session
        finally:
            sessions.close()
            await workers.close()

    logs = {log.name: log for log in asyncio.run(whole()).logs.values()}
    assert {name: log.state for name, log in logs.items()} == {
        "one.tlog": "done",
        "two.tlog": "done",
        "texts.zip": "failed",
    }
    assert logs["one.tlog"].note == (
        "From flights.zip; not judged in it: notes.txt, /etc/hostname, ../up.tlog"
    )
    assert logs["texts.zip"].problem == "it contains no log, but a.txt, b.txt"
