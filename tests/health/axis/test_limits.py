"""Limits from the profile decide, and the effectiveness shown is that of the present condition."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mavhums.actuator.profile import ProfileError, load_airframe
from mavhums.health.axis.monitor import AxisMonitor
from mavhums.results.sections import AxisLimits
from tests.health.axis.flights import changes_of, rolling
from tests.present import present

PROFILE = """name = "own"
[axes]
{axes}
[[actuators]]
name = "left aileron"
servo = 1
pwm_us = [1100, 1500, 1900]
"""


def profile(folder: Path, axes: str) -> Path:
    path = folder / "own.toml"
    path.write_text(PROFILE.format(axes=axes))
    return path


def test_a_profile_changes_the_limits_it_names(tmp_path: Path) -> None:
    found = load_airframe(profile(tmp_path, "effectiveness_emergency = 0.4\nlag_s = 0.6")).axes
    assert found == AxisLimits(effectiveness_emergency=0.4, lag_s=0.6)
    assert load_airframe("paper").axes == AxisLimits()


@pytest.mark.parametrize(
    ("axes", "said"),
    [
        ("effectiveness = 0.5", r"own.toml:3: axes.effectiveness: no such key"),
        ("effectiveness_emergency = 0.9", r"own.toml:2: axes: effectiveness_emergency must lie below"),
        ("effectiveness_degraded = 1.5", r"own.toml:3: axes.effectiveness_degraded"),
        ("lag_s = 0.0", r"own.toml:3: axes.lag_s"),
        ("lag_s = nan", r"own.toml:3: axes.lag_s"),
        ("trim_deviations = 1", r"own.toml:3: axes.trim_deviations"),
    ],
)
def test_a_wrong_limit_is_named_with_its_line(tmp_path: Path, axes: str, said: str) -> None:
    with pytest.raises(ProfileError, match=re.escape(said)):
        load_airframe(profile(tmp_path, axes))


@pytest.mark.parametrize(("limit", "condition"), [(0.65, "emergency"), (0.3, "degraded")])
def test_the_limit_decides_between_degraded_and_emergency(limit: float, condition: str) -> None:
    monitor = AxisMonitor(1, AxisLimits(effectiveness_emergency=limit))
    changes_of(monitor, rolling(180, lambda t: 2.2 * np.where(t >= 100, 0.5, 1.0)))
    assert monitor.findings("roll").worst == condition
    assert monitor.findings("roll").limits.effectiveness_emergency == limit


@pytest.mark.parametrize(("left", "condition"), [(0.5, "undecided"), (0.8, "unchanged")])
def test_a_loss_that_the_limits_tolerate_is_not_normal_below_60_percent(left: float, condition: str) -> None:
    monitor = AxisMonitor(1, AxisLimits(effectiveness_degraded=0.2, effectiveness_emergency=0.1))
    changes_of(monitor, rolling(130, lambda t: 2.2 * np.where(t >= 50, left, 1.0)))
    assert monitor.findings("roll").condition == condition


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(left=st.floats(0.0, 0.6), at_s=st.integers(70, 110), seconds=st.integers(25, 70))
@example(left=0.0, at_s=94, seconds=36)
def test_table_and_reason_name_the_same_figure(left: float, at_s: int, seconds: int) -> None:
    monitor = AxisMonitor(1)
    changes_of(monitor, rolling(at_s + seconds, lambda t: 2.2 * np.where(t >= at_s, left, 1.0)))
    found = monitor.findings("roll")
    if found.condition != "emergency" or found.suspects[0].fault != "effectiveness":
        return
    kept = present(found.effectiveness)
    assert kept.estimate == pytest.approx(left, abs=0.12)
    assert kept.low <= left <= kept.high
    [loss] = [one for one in found.evidence if one.kind == "effectiveness"]
    assert f"{100 * max(kept.estimate, 0.0):.0f} % of" in loss.rule


def test_after_recovery_the_figure_is_that_of_the_sound_axis() -> None:
    monitor = AxisMonitor(1)
    lost = lambda t: 2.2 * np.where((t >= 100) & (t < 160), 0.4, 1.0)  # noqa: E731
    last = [c for c in changes_of(monitor, rolling(300, lost)) if c.actuator == "roll"][-1]
    assert last.after == "unchanged"
    assert 180 <= last.time_s <= 220
    found = monitor.findings("roll")
    assert (found.condition, found.worst) == ("unchanged", "emergency")
    assert present(found.effectiveness).estimate == pytest.approx(1.0, abs=0.1)


def test_the_figure_of_a_loss_is_kept_with_its_reason_while_the_axis_is_only_better() -> None:
    monitor = AxisMonitor(1)
    partly = lambda t: 2.2 * np.where(t < 100, 1.0, np.where(t < 130, 0.4, 0.75))  # noqa: E731
    changes_of(monitor, rolling(220, partly))
    found = monitor.findings("roll")
    assert found.condition == "emergency"
    [loss] = [one for one in found.evidence if one.kind == "effectiveness"]
    assert loss.value == pytest.approx(present(found.effectiveness).estimate)
