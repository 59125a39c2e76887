"""One battery for every detector of an axis, and what only some of them see."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.signal import lfilter

from mavhums.health.axis.detectors import Persistent
from mavhums.health.axis.monitor import AxisMonitor
from tests.health.axis.flights import changes_of, excited, rows, steady


def test_one_second_alone_is_no_fault_and_its_onset_is_its_beginning() -> None:
    persistent = Persistent(limit=4.0)
    deviations = [5.0, 4.0, 5.0, 5.0, 5.0, np.nan, 5.0, 5.0]
    found = [persistent.feed(end_s, value) for end_s, value in enumerate(deviations, 101)]
    assert found == [None, None, None, 102, 102, None, None, 106]


def controlled(seconds: int) -> dict[str, np.ndarray]:
    """Turns that are demanded and flown, ailerons and all."""
    flight = steady(seconds)
    t = np.arange(seconds * 20) / 20
    flight["roll_demand"] = 0.5 * np.sign(np.sin(2 * np.pi * t / 40))
    flight["outputs"][:, 0] = excited(seconds)
    flight["roll_rate"] = 2.2 * flight["outputs"][:, 0] + 0.03 * np.random.default_rng(5).normal(size=t.size)
    # φ̈ = 6.25 (φ_demand − φ) − 5 φ̇ in rows of 0.05 s.
    flight["roll"] = lfilter([0.015625], [1.0, -1.734375, 0.75], flight["roll_demand"])
    return flight


def test_a_healthy_flight_raises_no_alarm() -> None:
    assert all(c.after == "unchanged" for c in changes_of(AxisMonitor(1), rows(controlled(240))))


@pytest.mark.parametrize(
    ("what", "axis", "fault"),
    [("roll", "roll", "tracking"), ("pitch", "pitch", "tracking"), ("trim", "roll", "hard_over"),
     ("skid", "yaw", "hard_over")],
)  # fmt: skip
def test_what_leaves_the_reference_is_found_in_seconds(what: str, axis: str, fault: str) -> None:
    flight = controlled(160)
    after = slice(100 * 20, None)
    if what == "roll":
        flight["roll"][after] += 0.9
    elif what == "pitch":
        flight["pitch"][after] -= 0.6
    else:
        flight["roll_rate"][after] += 0.6
        if what == "skid":
            flight["side_force"][after] += 4.0
    alarms = [c for c in changes_of(AxisMonitor(1), rows(flight)) if c.after == "emergency"]
    assert (alarms[0].actuator, alarms[0].fault) == (axis, fault)
    assert 100 < alarms[0].time_s <= 106
    assert 98 <= alarms[0].since_s <= 104
    assert fault != "hard_over" or re.search(r"rolls right \d+°/s|m/s² to the right", alarms[0].rule)


def test_a_stall_is_no_elevator() -> None:
    flight = controlled(160)
    flight["pitch"][2000:] -= 0.6
    flight["speed"][2000:] = 12.0
    assert all(change.after == "unchanged" for change in changes_of(AxisMonitor(1), rows(flight)))


@pytest.mark.parametrize(("rises_deg_s", "faulty"), [(6.0, False), (1.0, True), (0.0, True)])
def test_the_dive_after_a_stall_is_no_elevator_if_the_nose_comes_up(rises_deg_s: float, faulty: bool) -> None:
    """The speed comes back with the nose still low; with a lost elevator it may rise, too, but slowly."""
    flight = controlled(160)
    flight["pitch_demand"][1900:] = flight["pitch"][1900:] = 0.0
    flight["pitch"][2000:] -= 0.6
    flight["speed"][2000:2080] = 12.0
    risen = np.arange(1, 1121) * np.radians(rises_deg_s) / 20
    flight["pitch"][2080:] = np.minimum(flight["pitch"][2080:] + risen, 0.0)
    changes = changes_of(AxisMonitor(1), rows(flight))
    assert any(change.after == "emergency" for change in changes) is faulty
