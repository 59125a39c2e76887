"""Files that appear whole: what is no regular file is written through, links are followed."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from mavhums.core.errors import MavhumsError
from mavhums.core.output import written_whole

pytestmark = pytest.mark.skipif(os.name != "posix", reason="FIFOs and links of POSIX")


def write(path: Path, text: str = "new") -> None:
    with written_whole(path) as temporary:
        temporary.write_text(text)


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_fifo_is_written_through(tmp_path: Path) -> None:
    fifo = tmp_path / "pipe"
    os.mkfifo(fifo)
    got: list[str] = []
    reader = threading.Thread(target=lambda: got.append(fifo.read_text()), daemon=True)
    reader.start()
    write(fifo)
    reader.join(5.0)
    assert got == ["new"]
    assert stat.S_ISFIFO(fifo.stat().st_mode)
    assert left(tmp_path) == ["pipe"]


def test_a_device_is_written_through() -> None:
    before = Path("/dev/null").stat()
    write(Path("/dev/null"))
    assert Path("/dev/null").stat().st_ino == before.st_ino
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)


@pytest.mark.parametrize("there", [True, False])
def test_a_symbolic_link_stays(tmp_path: Path, there: bool) -> None:
    (tmp_path / "real").mkdir()
    target, link = tmp_path / "real" / "file", tmp_path / "link"
    if there:
        target.write_text("old")
    link.symlink_to(Path("real") / "file")
    write(link)
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert left(tmp_path / "real") == ["file"]


def test_permissions_stay(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.touch(mode=0o640)
    path.chmod(0o604)
    write(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o604


def test_a_new_file_is_its_owners_alone_also_while_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "file"
    with written_whole(path) as temporary:
        temporary.write_text("47.1, 8.5")
        assert stat.S_IMODE(temporary.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_a_failure_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("old")

    def fail() -> None:
        with written_whole(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert path.read_text() == "old"
    assert left(tmp_path) == ["file"]
    with pytest.raises(MavhumsError, match="cannot write"), written_whole(path):
        raise OSError("the disk is on fire")


def test_a_folder_or_an_absent_one_is_an_error_with_a_remedy(tmp_path: Path) -> None:
    with pytest.raises(MavhumsError, match="is a folder"):
        write(tmp_path)
    with pytest.raises(MavhumsError, match="No such file"):
        write(tmp_path / "absent" / "file")
    assert left(tmp_path) == []


_INTERRUPTED = """
import sys
from pathlib import Path
from mavhums.core.output import WholeFile
touch = Path.touch
def interrupted(path, *args, **options):
    touch(path, *args, **options)
    raise KeyboardInterrupt
Path.touch = interrupted
WholeFile(sys.argv[1])
"""


def test_a_signal_while_the_file_is_created_leaves_no_part_of_it(tmp_path: Path) -> None:
    command = [sys.executable, "-c", _INTERRUPTED, str(tmp_path / "out.json")]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.stderr.rstrip().endswith("KeyboardInterrupt")
    assert not list(tmp_path.iterdir())
