"""Windows of flights that nothing was trained on: decisions by condition, severity, mode and rate."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from rich.table import Table

from mavhums.actuator import load_airframe
from mavhums.core.arrays import Flags
from mavhums.learn import Model
from mavhums.learn.model import FRICTION_EMERGENCY
from mavhums.paper.flights import TELEMETRY
from mavhums.paper.windows import FlownWindows, fly_windows, measure
from mavhums_sim.manoeuvres import CYCLOGRAMS

SEED = 56_000_000
ACTUATOR = load_airframe("paper").actuators[2]


def heading(*titles: str) -> Table:
    made = Table(box=None, header_style="bold", pad_edge=False)
    for k, title in enumerate(titles):
        made.add_column(title, justify="right" if k else "left")
    return made


def percent(share: float) -> str:
    return "—" if np.isnan(share) else f"{100 * share:.2f} %"


class Judged:
    """A model's answers on windows."""

    def __init__(self, model: Model, windows: FlownWindows) -> None:
        assert model.card.window is not None
        answers = model.classify_windows(windows.features)
        self.windows, self.classes = windows, model.window_classes
        top = np.nan_to_num(answers.probabilities.max(axis=1))
        self.decided: Flags = answers.inside & (top >= model.card.window.decides_at)
        self.right: Flags = answers.probabilities.argmax(axis=1) == windows.classes
        self.p_emergency = answers.probabilities[:, model.window_classes.index(FRICTION_EMERGENCY)]
        self.inside = answers.inside

    def row(self, these: Flags) -> list[str]:
        """Number, share right of the decided, share abstained, and median probability of an emergency."""
        if not these.any():
            return ["0", "—", "—", "—"]
        decided = self.decided & these
        right = float(self.right[decided].mean()) if decided.any() else np.nan
        called = (self.p_emergency > 0.5) & self.inside
        return [
            str(int(these.sum())),
            percent(right),
            percent(float(1 - decided.sum() / these.sum())),
            percent(float(called[these].mean())),
        ]


def windows(models: dict[str, Model], flights: int, show: Callable[[Table], None]) -> None:
    """Print the confusion of each model, and its decisions by mode, rate, and third of the severities."""
    for number, (name, model) in enumerate(models.items()):
        flown = fly_windows(ACTUATOR, TELEMETRY[name], 12 * flights, seed=SEED + 100_000 * number)
        judged = Judged(model, flown)
        assert model.window is not None
        assert model.card.window is not None
        metrics, confusion = measure(model.window, flown, judged.classes, model.card.window.decides_at)
        said = ", ".join(f"{key.replace('_', ' ')} {value:g}" for key, value in metrics.items())
        told = heading(f"{name}: flown, decided as", *judged.classes, "abstained")
        told.caption = said
        for each, row in confusion.items():
            told.add_row(each, *(str(row.get(other, "")) for other in (*judged.classes, "abstained")))
        show(told)
        parts = heading(name, "windows", "right of the decided", "abstained", "p of an emergency > 0.5")
        parts.add_row("all", *judged.row(np.ones(len(flown), dtype=np.bool_)))
        for k, mode in enumerate(CYCLOGRAMS):
            parts.add_row(mode, *judged.row(flown.cyclogram == k))
        for rate in np.unique(flown.rate_hz)[::-1].tolist():
            parts.add_row(f"{rate:g} Hz", *judged.row(flown.rate_hz == rate))
        for k, each in enumerate(judged.classes):
            mine = flown.classes == k
            edges = np.quantile(flown.severity[mine], [0, 1 / 3, 2 / 3, 1]) if mine.any() else []
            for low, high in pairwise(edges):
                third = mine & (flown.severity >= low) & (flown.severity <= high)
                parts.add_row(f"{each} {low:.2f} … {high:.2f}", *judged.row(third))
        show(parts)
