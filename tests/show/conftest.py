"""A flight of 100 s with four actuators, as the engine would report it.

The elevator's friction grows from 0.225 to 1.0 N·m, the ailerons stay healthy, the rudder does not move.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.actuator.mapping import AirframeNamed, Samples
from mavhums.actuator.profile import load_airframe
from mavhums.core.conditions import Condition
from mavhums.core.quantities import KEYS
from mavhums.engine.events import Event, Notice
from mavhums.health.decision.events import ConditionChanged, Window
from mavhums.log.base.decoder import Losses
from mavhums.results.assessment import Assessment, LogSummary
from mavhums.results.sections import ModelSummary, NetworkAnswer, WindowsOfClass
from mavhums.results.verdict import Coverage, Evidence, Interval, Since, Suspect, Verdict

RATE = 100
DURATION = 100
NORMAL, EMERGENCY = 0.375, 0.875
NAMES = ("aileron_left", "aileron_right", "elevator", "rudder")


def quantities(time: NDArray[np.float64], torque: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """V1…V12 of the paper's EMA following a command against Coulomb friction and a hinge load."""
    rng = np.random.default_rng(seed)
    ratio, constant, resistance = 300.0, 0.01460784, 22.6457
    command = 18 * np.sin(0.9 * time + seed) + 7 * np.sin(2.3 * time)
    shaft = 18 * np.sin(0.9 * (time - 0.08) + seed) + 7 * np.sin(2.3 * (time - 0.08))
    speed = np.gradient(shaft, time) / 6
    load = 0.05 * shaft
    current = (load + torque * np.sign(speed)) / (ratio * constant) + rng.normal(0, 0.004, time.size)
    rotor = speed * ratio
    omega = rotor * 2 * np.pi / 60
    voltage = resistance * current + constant * omega + rng.normal(0, 0.02, time.size)
    columns = [command, shaft * ratio, shaft, voltage, current, voltage * current, rotor, constant * current]
    columns += [constant * current * omega, speed, load, load * omega / ratio]
    values: NDArray[np.float64] = np.column_stack(columns)
    return values


def samples_of(actuator: str, time_s: NDArray[np.float64], values: NDArray[np.float64]) -> Samples:
    """Return samples of an actuator of vehicle 1, all of them measured."""
    return Samples(1, actuator, time_s, values, np.ones(values.shape, dtype=bool))


@dataclass
class Flight:
    """Builds the events of one actuator after another, in the order of time."""

    absent: tuple[str, ...] = ()
    duration: int = DURATION
    emergencies: dict[str, float] = field(default_factory=lambda: {"elevator": 1.0})

    def friction(self, actuator: str, time: NDArray[np.float64]) -> NDArray[np.float64]:
        growth = np.clip((time - 20) / 60, 0, 1)
        return 0.225 + (self.emergencies.get(actuator, 0.225) - 0.225) * growth

    def samples(self, actuator: str, start: int, stop: int) -> Samples:
        time = np.arange(start * RATE, stop * RATE) / RATE
        values = quantities(time, self.friction(actuator, time), NAMES.index(actuator))
        if actuator == "rudder":
            values[:, [0, 1, 2, 4, 5, 6, 7, 8, 9, 10, 11]] = 0.0
        for key in self.absent:
            values[:, KEYS.index(key)] = np.nan
        return samples_of(actuator, time, values)

    def window(self, actuator: str, end: int) -> Window:
        if actuator == "rudder":
            return Window(1, actuator, end - 10.0, float(end), 0.0, None, "undecided")
        pause = actuator == "aileron_right" and 40 <= end < 55
        estimate = float(self.friction(actuator, np.array([end - 5.0]))[0]) + 0.01 * np.sin(end)
        estimated = Interval(estimate=estimate, low=estimate - 0.03, high=estimate + 0.03)
        vote = float(1 / (1 + np.exp(-(estimate - 0.65) * 18)))
        moving = 0.05 if pause else 0.72
        interval = None if pause else estimated
        said = (
            () if pause else ("friction_emergency", vote, vote) if vote > 0.5 else ("normal", 1 - vote, vote)
        )
        return Window(1, actuator, end - 10.0, float(end), moving, interval, condition(estimated), *said)

    def events(self) -> Iterator[Event]:
        held: dict[str, Condition] = dict.fromkeys(NAMES, "undecided")
        yield Notice(0.4, 1, "ArduPlane V4.6.0")
        yield AirframeNamed(0.5, 1, load_airframe("paper"))
        for second in range(self.duration):
            for actuator in NAMES:
                yield self.samples(actuator, second, second + 1)
                if second + 1 < 10:
                    continue
                window = self.window(actuator, second + 1)
                yield window
                before, after = held[actuator], window.condition
                held[actuator] = after
                if before != after:
                    since = window.start_s if before == "undecided" else window.end_s - 2.0
                    rule = f"the friction interval is {after} in 3 windows running"
                    yield ConditionChanged(1, actuator, window.end_s, since, before, after, rule)


def condition(friction: Interval) -> Condition:
    if friction.high >= EMERGENCY:
        return "emergency"
    return "degraded" if friction.low > NORMAL else "normal"


def new_verdict(
    actuator: str, state: Condition, estimate: float = 0.2, since: float | None = 0.0, /, **changes: object
) -> Verdict:
    """Return a verdict; other fields than these are set by ``changes``."""
    array = f"DEBUG_FLOAT_ARRAY[EMA,{NAMES.index(actuator) + 1}]"
    sources = {key: f"{array}.data[{i}]" for i, key in enumerate(KEYS)}
    known: dict[str, Any] = {"vehicle": 1, "actuator": actuator, "condition": state, "worst": state}
    known |= {"tier": "instrumented", "provenance": sources}
    if state == "undecided":
        return Verdict(
            **known,
            coverage=Coverage(moving_fraction=0.0, windows=91, decidable=0),
            reason="it did not move, and friction shows only in motion",
            remedy="record a flight, or a check on the ground, in which it moves for 10 s",
        ).model_copy(update=changes)
    stages = (
        (37.0, 72.0, 0.41, NORMAL, "the whole friction interval lies above the normal limit"),
        (72.0, 100.0, estimate, EMERGENCY, "the friction interval reaches the emergency limit"),
    )
    evidence = tuple(
        Evidence(kind="friction", start_s=start_s, end_s=end_s, value=value, limit=limit, rule=rule)
        for start_s, end_s, value, limit, rule in stages * (state == "emergency")
    )
    said = "friction_emergency" if state == "emergency" else "normal"
    return Verdict(
        **known,
        network=NetworkAnswer(
            model=ModelSummary(name="paper-ema", hash="abc"),
            inputs={"samples": ("V5", "V7"), "windows": ()},
            windows=91,
            classes={said: WindowsOfClass(windows=91, probability=0.998)},
            says=said,
            latest=said,
            probability=0.998,
            first_emergency_s=56.0 if state == "emergency" else None,
            share_of_samples=0.62 if state == "emergency" else 0.0006,
            condition="emergency" if state == "emergency" else "normal",
        ),
        friction_nm=Interval(estimate=estimate, low=estimate - 0.03, high=estimate + 0.03),
        suspects=(Suspect(fault="friction", confidence=0.97),) if state == "emergency" else (),
        since=None if since is None else Since(flight_time_s=since, utc="2025-06-01T10:01:12Z"),
        coverage=Coverage(moving_fraction=0.72, windows=91, decidable=91),
        evidence=evidence,
    ).model_copy(update=changes)


def new_assessment(*verdicts: Verdict, losses: Losses | None = None, **changes: object) -> Assessment:
    log = LogSummary(
        path="flights/2025-06-01.tlog", sha256="0" * 64, start_utc="2025-06-01T10:00:00Z",
        duration_s=100.0, vehicles=(1,), losses=losses or Losses(),
    )  # fmt: skip
    model = ModelSummary(name="paper-ema", hash="abc")
    whole = Assessment(log=log, airframe="paper", model=model, verdicts=verdicts)
    return whole.model_copy(update=changes)


@pytest.fixture(scope="session")
def flight() -> Flight:
    return Flight()


@pytest.fixture(scope="session")
def assessment() -> Assessment:
    return new_assessment(
        new_verdict("aileron_left", "normal", 0.222, 0.0),
        new_verdict("aileron_right", "normal", 0.231, 0.0),
        new_verdict("elevator", "emergency", 1.003, 72.0),
        new_verdict("rudder", "undecided", 0.0, None),
        losses=Losses(bytes_skipped=1234, damaged_regions=3, bad_crc_frames=2, unknown_frames=1),
    )
