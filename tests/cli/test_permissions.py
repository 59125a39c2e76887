"""What commands create holds positions, so it is its user's alone, whatever the umask."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import CARRIED

pytestmark = pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")


@pytest.mark.slow
def test_files_and_folders_are_the_users_alone(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there").chmod(0o755)  # a command that ran in this process has left its umask
    log = CARRIED / "friction.BIN"
    commands = (
        ("analyse", log, "--rrd", "flight.rrd", "--store", "own/store", "--keep", "--aircraft", "=D-A"),
        ("fleet", "scan", log, "--store", "store", "--workers", "0"),
        ("fleet", "scan", log, "--store", "there/store", "--workers", "0"),
        ("fleet", "export", "--store", "store", "-o", "fleet.csv"),
    )
    for command in commands:
        program = [sys.executable, "-m", "mavhums", *map(str, command)]
        subprocess.run(program, cwd=tmp_path, umask=0o002, check=False, capture_output=True)
    created = {path.relative_to(tmp_path): path.stat().st_mode & 0o777 for path in tmp_path.rglob("*")}
    assert created.pop(Path("there")) == 0o755, "what was there keeps its permissions"
    assert {path.parts[0] for path in created} == {"flight.rrd", "own", "store", "there", "fleet.csv"}
    others = {path: oct(mode) for path, mode in created.items() if mode & 0o077}
    assert not others
