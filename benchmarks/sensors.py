"""Faults found where a sensor fails: what moves the aircraft does what it did.

    python -m benchmarks.sensors [LOG|FOLDER ...] [--airframe PROFILE] [--only REGEX]

Each log is judged again with what one sensor measures changed as a failure changes it, whatever the format:
an airspeed that reads too much, too little, nothing, or one number from the middle of the log on; a receiver
that leaps; an altitude, a heading or a level that jumps; noise of gyro and accelerometer; outputs with coarse
pulses. Printed is each subject that is worse than in the intact log, as in ``benchmarks/thinned.py``. Without
a log a simulated quad is judged.

The exit status is 1 if a subject is worse.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from benchmarks.holes import simulated
from benchmarks.thinned import compare, conditions, judged, logs_of, report, time_span_us
from mavhums.app.settings import Settings
from mavhums.core.arrays import Array
from mavhums.vehicle.formats.base import FactReport

Change = Callable[[Array, Array], Array]
"""Returns the changed values, shape (n, k), given the values and the place of each row in the log, 0 to 1."""


def plus(*offsets: float) -> Change:
    """Add a number to each column."""
    return lambda values, _: values + np.array(offsets)


def times(factor: float) -> Change:
    """Multiply by a number."""
    return lambda values, _: values * factor


def noisy(deviation: float) -> Change:
    """Add white noise, which depends on the place in the log alone."""

    def change(values: Array, place: Array) -> Array:
        rng = np.random.default_rng(int(1e9 * place[0]) % 2**32 if len(place) else 0)
        return values + rng.normal(0.0, deviation, values.shape)

    return change


def from_middle(change: Change, until: float = np.inf) -> Change:
    """Return a change that begins in the middle of the log."""

    def later(values: Array, place: Array) -> Array:
        fails = (place >= 0.5) & (place < until)
        return np.where(fails[:, None], change(values, place), values)

    return later


class Frozen:
    """Repeats the first value from the middle of the log on."""

    def __init__(self) -> None:
        self._value: Array | None = None

    def __call__(self, values: Array, place: Array) -> Array:
        """Return the changed values."""
        fails = place >= 0.5
        if self._value is None and fails.any():
            self._value = values[fails.argmax()].copy()
        return values if self._value is None else np.where(fails[:, None], self._value, values)


LOST: Final = from_middle(times(np.nan))
AIRSPEED: Final = ("airspeed", "sensed airspeed")


def failures() -> dict[str, dict[str, Change]]:
    """Return the changes of facts by the name of the failure."""
    airspeeds: dict[str, Change] = {
        "reads 25 % too much": times(1.25),
        "reads 20 % too little": times(0.8),
        "reads 40 % too much later": from_middle(times(1.4)),
        "reads 40 % too little later": from_middle(times(0.6)),
        "is blocked": Frozen(),
        "is lost": LOST,
        "is zero": from_middle(times(0.0)),
        "is noisy by 2 m/s": noisy(2.0),
    }
    tilted, turned = np.radians(4.0), np.radians(40.0)
    return {
        **{f"airspeed {name}": dict.fromkeys(AIRSPEED, change) for name, change in airspeeds.items()},
        "ground velocity is lost": {"velocity": LOST, "groundspeed": LOST},
        "ground velocity leaps by 30 m/s": {"velocity": from_middle(plus(30.0, 0.0, 0.0), 0.6)},
        "ground velocity is noisy by 2 m/s": {"velocity": noisy(2.0)},
        "altitude leaps by 80 m": {"altitude": from_middle(plus(80.0))},
        "altitude is frozen": {"altitude": Frozen()},
        "altitude is noisy by 4 m": {"altitude": noisy(4.0)},
        "roll is 4° off": {"attitude": plus(tilted, 0.0, 0.0)},
        "roll is 4° off later": {"attitude": from_middle(plus(tilted, 0.0, 0.0))},
        "pitch is 4° off later": {"attitude": from_middle(plus(0.0, tilted, 0.0))},
        "heading leaps by 40°": {"attitude": from_middle(plus(0.0, 0.0, turned))},
        "gyro is noisy by 0.1 rad/s": {"rates": noisy(0.1)},
        "gyro is off by 0.06 rad/s later": {"rates": from_middle(plus(0.06, 0.06, 0.06))},
        "accelerometer is noisy by 3 m/s²": {"force": noisy(3.0)},
        "accelerometer is off by 0.6 m/s² later": {"force": from_middle(plus(0.0, 0.6, 0.0))},
        "outputs come in steps of 8 µs": {"outputs": lambda values, _: np.round(values / 8.0) * 8.0},
        "servo rail reads nothing": {"servo rail": from_middle(times(0.0))},
    }


@contextmanager
def failing(changes: Mapping[str, Change], first_us: int, last_us: int) -> Iterator[None]:
    """Change what every format reads of these facts, over the time of a log."""
    intact: Callable[[FactReport], Any] = vars(FactReport)["values"].fget

    def values(rows: FactReport) -> Any:
        found, change = intact(rows), changes.get(rows.source.fact)
        if change is None:
            return found
        place = (rows.table.time_us - first_us) / max(last_us - first_us, 1)
        with np.errstate(all="ignore"):
            return change(np.atleast_2d(np.asarray(found, dtype=np.float64).T).T, place)

    with patch.object(FactReport, "values", property(values)):
        yield


def run(path: Path, settings: Settings, only: str) -> tuple[int, list[str]]:
    """Return in how many ways a sensor of a log failed, and what became worse."""
    intact, _ = judged(path, settings)
    first_us, last_us = time_span_us(path)
    chosen = {name: changes for name, changes in failures().items() if re.search(only, name)}
    worse: list[str] = []
    for name, changes in chosen.items():
        with failing(changes, first_us, last_us):
            failed, _ = judged(path, settings)
        worse += [f"{name}: {one}" for one in compare(conditions(intact), conditions(failed))]
    return len(chosen), worse


def main() -> int:
    """Judge all logs with each failure; return 1 if a subject is worse."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("places", nargs="*", type=Path)
    parser.add_argument("--airframe", default=None)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    settings = Settings.read(None, airframe=given.airframe)
    with tempfile.TemporaryDirectory() as folder:
        logs = [*logs_of(given.places)] or [simulated(Path(folder))]
        return report(logs, lambda path: run(path, settings, given.only), "a sensor failed")


if __name__ == "__main__":
    raise SystemExit(main())
