"""What is printed: nothing that a terminal obeys, nothing that it cannot show, and never a traceback."""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from rich.console import Console

from mavhums.cli import main as cli
from mavhums.core.errors import ExitCode
from mavhums.core.output import writer_for
from mavhums.log.base.decoder import Losses, SequenceLoss
from mavhums.results.assessment import Assessment
from mavhums.show.terminal import render
from mavhums.show.words import losses
from tests.conftest import Run
from tests.flights import flown, verdict

HOSTILE = "evil\x1b]0;owned\x07\x1b[2J\x9b31m.tlog"


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["cp1252", "cp437", "ascii"])
@pytest.mark.parametrize("as_json", [True, False])
def test_any_encoding_carries_the_answer(
    monkeypatch: pytest.MonkeyPatch, short_log: Path, encoding: str, as_json: bool
) -> None:
    raw = io.BytesIO()
    out = io.TextIOWrapper(raw, encoding=encoding, write_through=True)
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "argv", ["mavhums", "analyse", str(short_log), *(["--json"] if as_json else [])])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert stop.value.code == ExitCode.OK
    text = raw.getvalue().decode(encoding)
    if as_json:
        assert Assessment.model_validate(json.loads(text)).verdicts[0].friction_nm
        assert json.loads(text)["verdicts"][0]["indicators"][0]["unit"] in ("N·m", "°", "1", "V", "Ω")
    else:
        assert "aileron_left" in text


FULL = "mavhums: cannot write the standard output: No space left on device"


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full and a shell of POSIX")
@pytest.mark.parametrize(
    ("command", "code", "lines"),
    [
        ("analyse {} | head -c 3", ExitCode.EMERGENCY, []),
        ("analyse {} > /dev/full", ExitCode.EMERGENCY, [FULL]),
        ("inspect {} > /dev/full", ExitCode.ERROR, [FULL]),
        ("analyse {} <&- >&- 2>&-", ExitCode.EMERGENCY, []),
        ("inspect - <&-", ExitCode.ERROR, None),
    ],
)
def test_the_exit_code_is_that_of_the_verdict_whoever_reads_it(
    growing_log: Path, command: str, code: ExitCode, lines: list[str] | None
) -> None:
    """The output is a pipe whose reader ends, a full disk, or closed from the start."""
    program = f"{sys.executable} -m mavhums {command.format(growing_log)}; echo ${{PIPESTATUS[0]}} >&3"
    done = subprocess.run(
        ["bash", "-c", f"exec 3>&1; {program}"], capture_output=True, text=True, timeout=60, check=False
    )
    assert int(done.stdout.removeprefix("e").splitlines()[-1][-2:]) == code
    assert "Traceback" not in done.stderr
    assert lines is None or done.stderr.splitlines() == lines


def test_hostile_names_reach_no_terminal(run: Run, tmp_path: Path, short_log: Path) -> None:
    store = tmp_path / f"{HOSTILE}.sqlite"
    store.write_text("no database")
    log = tmp_path / HOSTILE
    log.write_bytes(short_log.read_bytes())
    for arguments in (
        ["analyse", log, "--store", store],
        ["analyse", log, "--json"],
        ["analyse", tmp_path / f"absent{HOSTILE}"],
        ["inspect", log],
        ["trend", "--store", store],
        ["export", log, "-o", tmp_path / f"{HOSTILE}.csv"],
        ["profile", "new", log],
    ):
        outcome = run(*arguments)
        for text in (outcome.out, outcome.err):
            assert all(letter.isprintable() or letter == "\n" for letter in text), arguments


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="names of other systems are texts")
def test_a_name_that_is_not_utf_8_is_a_text_of_the_answer(
    run: Run, tmp_path: Path, short_log: Path, growing_log: Path
) -> None:
    folder = tmp_path / "logs"
    folder.mkdir()
    log = folder / os.fsdecode(b"flight\xfc.tlog")
    log.write_bytes(short_log.read_bytes())
    shutil.copy(growing_log, folder)
    shown = f"{folder}/flight\\xfc.tlog"
    assert json.loads(run("analyse", log, "--json").out)["log"]["path"] == shown
    assert json.loads(run("inspect", log, "--json").out)["assessment"]["log"]["path"] == shown
    assert run("analyse", log, "--store", tmp_path / "h", "--aircraft", "=D-A", "--keep").code == ExitCode.OK
    for arguments in (
        ["analyse", log, "--aircraft", os.fsdecode(b"=\xfc")],
        ["export", log, "-o", folder / os.fsdecode(b"\xfc.parquet")],
    ):
        refused = run(*arguments)
        assert refused.code == ExitCode.ERROR
        assert "is not UTF-8" in refused.err
    store = ("--store", tmp_path / "store")
    assert run("fleet", "scan", folder, *store, "--workers", "0").code == ExitCode.ERROR
    found = json.loads(run("fleet", "status", *store, "--json").out)
    assert [one["problem"] for one in found["failures"]] == [f"{shown}: its name is not UTF-8"]
    assert found["judged"] == 1


def test_formulas_are_texts_in_a_spreadsheet(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    evil = ["=HYPERLINK(1)", "+1", "-cmd", "@SUM(A1)", "\tx", "elevator"]
    with writer_for(path)(path) as table:
        table.write(pd.DataFrame({"actuator": evil, "estimate": [-0.5] * len(evil)}))
    read = pd.read_csv(path)
    assert list(read["actuator"]) == [*(f"'{text}" for text in evil[:-1]), "elevator"]
    assert set(read["estimate"]) == {-0.5}


@pytest.mark.slow
def test_several_logs_are_named(run: Run, short_log: Path, growing_log: Path, tmp_path: Path) -> None:
    absent = tmp_path / "absent.tlog"
    outcome = run("analyse", short_log, absent, growing_log, "--verbose")
    assert outcome.code == ExitCode.EMERGENCY, "an error in one log must not hide an emergency in another"
    lines = outcome.out.splitlines()
    headings = [line for line in lines if line.startswith("===")]
    assert headings == [f"=== {short_log} ===", f"=== {growing_log} ==="]
    assert lines.index(headings[0]) < lines.index(headings[1])
    logs = {log.name for log in (growing_log, absent, short_log)}
    table = [row for line in lines if (row := line.split()) and row[0] in logs and row[-1].isdecimal()]
    assert [row[-1] for row in table] == ["11", "1", "0"], "worst first, whatever the order given"
    assert [row[0] for row in table] == [growing_log.name, absent.name, short_log.name]
    assert "EMERGENCY" in table[0]
    assert "===" not in run("analyse", short_log).out


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_a_narrow_table_keeps_the_actuators_names(width: int) -> None:
    names = ["aileron_left_outboard", "aileron_right_outboard", "elevator"]
    assessment = flown(*(verdict(actuator=name, condition="emergency") for name in names))
    file = io.StringIO()
    render(assessment, Console(width=width, file=file))
    table = file.getvalue().partition("actuator ")[2]
    assert all(any(name in line for line in table.splitlines()) for name in names)
    assert all(len(line) <= width for line in table.splitlines())


def test_what_the_link_lost_is_not_lost_of_the_file() -> None:
    sender = SequenceLoss(system=1, component=1, frames=952, missing=48, gaps=3, reordered=0, duplicated=0)
    assert losses(Losses(sequence=(sender,))) == "file intact; the radio link lost 4.8 %"
    assert losses(Losses(bad_crc_frames=1, sequence=(sender,))) == (
        "1 frame with a wrong checksum; the radio link lost 4.8 %"
    )


def test_of_several_logs_what_is_not_normal_is_shown(run: Run, short_log: Path, growing_log: Path) -> None:
    several = run("analyse", short_log, growing_log).out
    assert [line for line in several.splitlines() if line.startswith("===")] == [f"=== {growing_log} ==="]
    assert "What to do: do not fly" in several
    assert "Usage" not in several
    assert several.count("airworthiness") == 1
    assert len(several.splitlines()) < len(run("analyse", growing_log).out.splitlines()) + 8
