"""The report end to end: a log goes in, one file comes out."""

from __future__ import annotations

from pathlib import Path

import pytest

from mavhums.core.errors import ExitCode
from tests.conftest import REAL_LOGS, Run


def test_a_growing_fault_is_shown_with_its_curve(run: Run, growing_log: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    code, out, _ = run("report", growing_log, "-o", page)
    assert code == ExitCode.EMERGENCY
    assert f"report: {page}" in out
    text = page.read_text(encoding="utf-8")
    assert "EMERGENCY: elevator (servo 3): friction " in text
    assert text.count("<svg") == 1 + 2 * 4 + 2  # the aircraft; friction and network of each actuator; angles
    assert "emergency from" in text
    assert len(text.encode()) < 3_000_000
    assert str(growing_log.parent) not in text, "whoever gets the page learns nothing of the sender's disk"


def test_an_ordinary_log_shows_what_could_be_judged(run: Run, tmp_path: Path) -> None:
    log = REAL_LOGS / "sitl" / "plane_normal.mavproxy.tlog"
    if not log.exists():
        pytest.skip("the real logs are not here")
    page = tmp_path / "report.html"
    code = run("report", log, "-o", page).code
    assert code == ExitCode.UNDECIDED
    text = page.read_text(encoding="utf-8")
    assert "roll control: control effectiveness" in text
    assert text.count("data-plot") >= 1
    assert "rudder (servo 4)" in text
