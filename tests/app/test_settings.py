"""What the options name is read once, and an error has one sentence wherever a log is judged."""

from __future__ import annotations

import time
from dataclasses import fields
from pathlib import Path

import pytest

import mavhums
from mavhums.app.analysis import Failed, Judged, judge
from mavhums.app.settings import GivenOptions, Options, Settings
from mavhums.core.process_pool import LostItem, in_processes


def test_settings_are_not_read_again() -> None:
    settings = Settings.read(Options(airframe="paper"))
    assert Settings.read(settings) is settings


def test_any_error_is_a_problem_with_its_remedy(growing_log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = Settings.read(None)
    assert isinstance(judge(growing_log, settings), Judged)

    def failing(error: Exception) -> Failed:
        def fail(*_: object, **__: object) -> None:
            raise error

        monkeypatch.setattr("mavhums.app.analysis.analyse_alone", fail)
        failed = judge(growing_log, settings)
        assert isinstance(failed, Failed)
        assert failed.remedy
        assert failed.error.problem == failed.problem
        return failed

    known = mavhums.MissingExtraError("reading it", "zstd")
    assert failing(known).error is known
    assert "memory" in failing(MemoryError()).problem
    assert failing(ZeroDivisionError("nought")).problem == f"{growing_log}: ZeroDivisionError: nought"


def _hangs_at_two(number: int) -> int:
    if number == 2:
        time.sleep(600)
    return 2 * number


@pytest.mark.slow
def test_an_item_that_hangs_costs_only_itself() -> None:
    results = list(in_processes(_hangs_at_two, range(5), 2, item_s=3.0))
    assert results == [0, 2, LostItem(hung=True), 6, 8]


def test_options_may_be_given_by_name(growing_log: Path) -> None:
    assert {*GivenOptions.__annotations__} == {field.name for field in fields(Options)}
    by_name = mavhums.analyse(growing_log, airframe="paper", false_alarms=2.0)
    assert by_name == mavhums.analyse(growing_log, Options(airframe="paper", false_alarms=2.0))
    assert by_name == mavhums.analyse(growing_log, Options(false_alarms=2.0), airframe="paper")
    with pytest.raises(TypeError, match="str is no Options object"):
        mavhums.analyse(growing_log, "paper")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="frame"):
        mavhums.analyse(growing_log, frame="paper")  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="airframe"):
        mavhums.analyse(growing_log, Settings.read(None), airframe="paper")
    with pytest.raises(mavhums.ProfileError, match="no airframe profile"):
        mavhums.Engine(mavhums.EngineOptions(airframe="nowhere"))
    assert mavhums.Engine(mavhums.EngineOptions(airframe="paper")).assessment() == (
        mavhums.Engine(mavhums.EngineOptions(airframe=mavhums.load_airframe("paper"))).assessment()
    )
