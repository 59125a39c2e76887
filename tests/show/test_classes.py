"""The network's answer on each sample: in the recording, and as a picture of the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mavhums.health.decision.events import Classified
from mavhums.results.assessment import Assessment
from mavhums.show.curves import EvidenceCollector
from mavhums.show.html import page
from tests.present import present
from tests.show.conftest import Flight
from tests.show.test_recording import entities, rows, scalars, static, write

Floats = NDArray[np.float64]
CLASSES = ("normal", "emergency")
NETWORK = "/vehicle_1/elevator/network"


def classified(p: Sequence[float] | Floats, *, inside: Sequence[bool] | None = None) -> Classified:
    """Samples at 100 Hz with these probabilities."""
    values = np.asarray(p, dtype=np.float64)
    said = np.where(np.isnan(values), -1, values > 0.5).astype(np.int8)
    within = np.isfinite(values) if inside is None else np.asarray(inside)
    return Classified(1, "elevator", np.arange(values.size) / 100, values, said, within, CLASSES)


def recorded(tmp_path: Path, flight: Flight, assessment: Assessment, *events: Classified) -> Path:
    return write(tmp_path / "f.rrd", [*flight.events(), *events], assessment)


def test_every_sample_and_every_change_of_a_windows_class_is_recorded(
    tmp_path: Path, flight: Flight, assessment: Assessment
) -> None:
    p = [0.1, 0.2, 0.9, 0.8, 0.1, np.nan, 0.9, 0.9]
    inside = [True] * 7 + [False]
    path = recorded(tmp_path, flight, assessment, classified(p, inside=inside))
    time, found = scalars(path, f"{NETWORK}/samples")
    np.testing.assert_array_equal(found[:, 0], [*p[:-1], np.nan])
    np.testing.assert_allclose(time, np.arange(8) / 100, atol=1e-9)
    at, states = rows(path, f"{NETWORK}/class", "StateChange:state")
    said = [flight.window("elevator", end).network for end in range(10, 101)]
    turn = said.index("friction_emergency")
    assert [state[0] for state in states] == ["normal", "friction_emergency"]
    np.testing.assert_allclose(at, [5.0, 5.0 + turn])
    assert static(path, f"{NETWORK}/class")["StateConfiguration:values"] == ["normal", "friction_emergency"]


def test_a_long_flight_keeps_every_lone_sample_of_another_class(
    tmp_path: Path, flight: Flight, assessment: Assessment
) -> None:
    p = np.full(400_000, 0.01)
    lone = np.arange(777, p.size, 40_000)
    p[lone] = 0.99
    path = recorded(tmp_path, flight, assessment, *map(at_100_hz, np.array_split(p, 50), range(50)))
    time, found = scalars(path, f"{NETWORK}/samples")
    assert found.shape[0] <= 32768
    np.testing.assert_allclose(time[found[:, 0] > 0.5], lone / 100, atol=1.0)


def at_100_hz(p: Floats, part: int) -> Classified:
    event = classified(p)
    return replace(event, time_s=event.time_s + part * p.size / 100)


def test_without_a_network_nothing_is_drawn(tmp_path: Path, flight: Flight, assessment: Assessment) -> None:
    path = recorded(tmp_path, flight, assessment, classified(np.full(8, np.nan)))
    assert f"{NETWORK}/samples" not in entities(path)


def test_the_report_shows_each_sample_beside_the_windows(flight: Flight, assessment: Assessment) -> None:
    gathered = EvidenceCollector()
    gathered.consume(flight.events())
    assert 'class="samples"' not in page(assessment, gathered)
    p = np.full(10_000, 0.02)
    p[5_000] = 0.98
    gathered.consume([classified(p)])
    curve = gathered.networks()[1, "elevator"]
    samples = present(curve.samples)
    assert samples.shape[1] <= 1200
    assert samples[1].max() == 0.98
    assert curve.time_s.tolist() == [end - 5.0 for end in range(10, 101)]
    text = page(assessment, gathered)
    assert text.count('class="samples"') == 1
    assert "elevator: paper-ema" in text
    assert "range it calls 62 % an emergency" in text
