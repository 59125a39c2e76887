"""Windows of flights that nothing was trained on: decisions by condition, severity, mode and rate."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from mavhums.actuator.profile import load_airframe
from mavhums.core.arrays import Flags
from mavhums.learn import Model
from mavhums.paper.flights import TELEMETRY
from mavhums.paper.windows import FlownWindows, fly_windows, measure
from mavhums_sim.manoeuvres import CYCLOGRAMS

SEED = 56_000_000
CYCLOGRAMS_EACH = 12
NAMES = {"instrumented": "instrumented", "without-load": "without load torque", "esc": "ESC"}
ACTUATOR = load_airframe("paper").actuators[2]


class Judged:
    """A model's answers on windows."""

    def __init__(self, model: Model, windows: FlownWindows) -> None:
        assert model.card.window is not None
        answers = model.classify_windows(windows.features)
        self.windows, self.classes = windows, model.window_classes
        top = np.nan_to_num(answers.probabilities.max(axis=1))
        self.decided: Flags = answers.inside & (top >= model.card.window.decides_at)
        self.right: Flags = answers.probabilities.argmax(axis=1) == windows.classes
        self.confusion: dict[str, dict[str, int]] = {}

    def decisions(self, flown: str) -> str:
        """Return how many windows of a condition are decided rightly, as others, and not at all."""
        if flown not in self.confusion:
            return "–"
        counts = Counter(self.confusion[flown])
        right, abstained = counts.pop(flown, 0), counts.pop("abstained", 0)
        wrong = [f"{count} {name.replace('_', ' ')}" for name, count in counts.most_common()]
        return ", ".join([f"{right} right", *wrong, f"{abstained} abstained"])

    def by_severity(self) -> Iterator[str]:
        """Yield the decisions on each third of the severities of each condition."""
        for k, each in enumerate(self.classes):
            mine = self.windows.classes == k
            edges = np.quantile(self.windows.severity[mine], [0, 1 / 3, 2 / 3, 1]) if mine.any() else []
            for low, high in pairwise(edges):
                third = mine & (self.windows.severity >= low) & (self.windows.severity <= high)
                yield f"{each} {low:.2f}…{high:.2f} {self.row(third)}"

    def row(self, these: Flags) -> str:
        """Return the shares right of the decided / abstained."""
        decided = self.decided & these
        if not decided.any():
            return "–"
        right, abstained = self.right[decided].mean(), 1 - decided.sum() / these.sum()
        return f"{100 * right:.1f} / {100 * abstained:.0f} %"


def _table(title: str, rows: dict[str, list[str]]) -> None:
    print(f"| {title} | {' | '.join(NAMES.values())} |")
    print("|---" * (1 + len(NAMES)) + "|")
    for name, cells in rows.items():
        print(f"| {name.replace('_', ' ')} | {' | '.join(cells)} |")


def windows(models: dict[str, Model], flights: int) -> None:
    """Print what each model decides: in all, by condition, mode and rate, and third of the severities."""
    judged = {}
    print(
        "| network | right of the decided, card | last look | abstained, card / last look | decides from | ",
        end="",
    )
    print("calibration error, card / last look |\n|---|---|---|---|---|---|")
    for number, (name, model) in enumerate(models.items()):
        flown = fly_windows(
            ACTUATOR, TELEMETRY[name], CYCLOGRAMS_EACH * flights, seed=SEED + 100_000 * number
        )
        card = model.card.window
        assert model.window is not None
        assert card is not None
        judged[name] = Judged(model, flown)
        found, judged[name].confusion = measure(model.window, flown, judged[name].classes, card.decides_at)
        cells = [f"{100 * metrics['decided_right']:.2f} %" for metrics in (card.metrics, found)]
        both = " / ".join(f"{100 * metrics['abstained']:.1f}" for metrics in (card.metrics, found))
        cells += [f"{both} %", f"{card.decides_at:g}"]
        cells += [" / ".join(f"{one['expected_calibration_error']:.3f}" for one in (card.metrics, found))]
        print(f"| {NAMES[name]} | {' | '.join(cells)} |", flush=True)
    print("\nRightly decided, decided as another, abstained:\n")
    rows = {
        label: [one.decisions(label) for one in judged.values()]
        for label in max((one.classes for one in judged.values()), key=len)
    }
    _table("flown", rows)
    print("\nRight of the decided / abstained:\n")
    rows = {
        mode: [one.row(one.windows.cyclogram == k) for one in judged.values()]
        for k, mode in enumerate(CYCLOGRAMS)
    }
    for rate in (100.0, 50.0, 25.0, 10.0):
        rows[f"{rate:g} Hz"] = [one.row(one.windows.rate_hz == rate) for one in judged.values()]
    _table("mode or rate", rows)
    for name, one in judged.items():
        print(f"\n{NAMES[name]}, by severity: {'; '.join(one.by_severity())}")
