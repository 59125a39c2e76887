from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mavhums.cli.importer import HEAD, is_log
from tests.conftest import carried_logs, real_logs

IMPORTER = [sys.executable, "-m", "mavhums.cli.importer"]


@pytest.mark.parametrize("path", [*carried_logs(), *real_logs()], ids=lambda path: path.name)
def test_logs_are_known_by_their_first_bytes(path: Path) -> None:
    ours = path.suffix.lower() in (".tlog", ".raw", ".bin", ".ulg")
    assert is_log(path.read_bytes()[:HEAD]) == ours


def test_a_damaged_beginning_does_not_matter(healthy_log: Path) -> None:
    data = healthy_log.read_bytes()
    assert is_log(b"garbage" * 500 + data[137:HEAD])
    assert is_log(data[: HEAD // 50])


@given(st.binary(max_size=4000))
def test_noise_is_no_log(data: bytes) -> None:
    assume(not data.startswith((b"\xa3\x95", b"ULog")))
    assert not is_log(data)


@pytest.mark.parametrize("name", ["picture.png", "text.txt", "empty", "recording.rrd", "flight.bin"])
def test_foreign_files_are_refused_before_rerun_is_imported(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    contents = {"picture.png": b"\x89PNG\r\n\x1a\n" + bytes(9000), "text.txt": b"\xfe\xff" * 4000}
    path.write_bytes(contents.get(name, b"RRF2" * 1000 if name == "recording.rrd" else b""))
    code = f"""
import sys
sys.argv = ["rerun-importer-mavhums", {str(path)!r}, "--application-id", "x", "--recording-id", "y", "--new"]
import atexit
heavy = {{"rerun", "numba", "numpy", "pymavlink"}}
atexit.register(lambda: print(sorted(heavy & set(sys.modules)), file=sys.stderr))
from mavhums.cli.importer import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr.strip()) == (66, "", "[]")


def test_a_folder_and_a_missing_file_are_foreign(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "missing.tlog"):
        assert subprocess.run([*IMPORTER, str(path)], capture_output=True, check=False).returncode == 66


@pytest.mark.slow
def test_the_viewer_opens_a_log(healthy_log: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="the importer needs the extra 'viewer'")
    import rerun_cli

    from tests.show.test_recording import rows, static

    program = tmp_path / "rerun-importer-mavhums"
    program.write_text(f'#!/bin/sh\nexec {" ".join(IMPORTER)} "$@"\n')
    program.chmod(0o755)
    viewer, out = Path(rerun_cli.__file__).with_name("rerun"), tmp_path / "imported.rrd"
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    command = [str(viewer), str(healthy_log), "--port", "auto", "--bind", "127.0.0.1", "--save", str(out)]
    subprocess.run(command, env=environment, check=True, capture_output=True, timeout=120)
    subprocess.run([viewer, "rrd", "verify", out], check=True, capture_output=True)
    assert static(out, "/report")["TextDocument:text"][0].startswith("# normal: aileron_left")
    assert static(out, "/__properties/mavhums")["condition"] == ["normal"]
    assert rows(out, "/vehicle_1/elevator", "StateChange:state")[1] == [["normal"]]


@pytest.mark.slow
def test_the_airframe_comes_from_the_environment_and_errors_are_told(healthy_log: Path) -> None:
    pytest.importorskip("rerun", reason="the importer needs the extra 'viewer'")
    environment = {**os.environ, "MAVHUMS_AIRFRAME": "nowhere"}
    done = subprocess.run([*IMPORTER, str(healthy_log)], env=environment, capture_output=True, check=False)
    assert done.returncode == 1
    assert b"no airframe profile 'nowhere'; name a TOML file, or one of: paper" in done.stderr
