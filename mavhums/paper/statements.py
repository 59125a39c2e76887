"""The paper's statements, judged over weight decay: confirmed, not confirmed, or dependent on it."""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd

from mavhums.core.quantities import KEYS
from mavhums.paper.cyclograms import BEST_12, BEST_SELECTED, SELECTED, TAKEOFF
from mavhums.paper.experiment import Experiment
from mavhums.paper.tables import Findings

POINT: Final = 0.5
"""A figure is confirmed within so many points, an order of accuracies where it holds by so many."""
FASTER: Final = 2 / 3
"""Of the time of twelve inputs that four take where learning counts as significantly faster."""

_NEAREST = ((0.375, (0.225, 0.275, 0.325)), (0.875, (0.925, 0.975, 1.025)))


def decay_table(findings: Findings) -> pd.DataFrame:
    """Return the accuracies of tables 4 and 5 by cyclogram, inputs and weight decay, %."""
    rows = []
    for (cyclogram, decay), experiments in findings.decays.items():
        for found in experiments:
            test, mlp = found.table["test"], findings.mlp.get((found.inputs, decay), np.array([]))
            rows.append(
                {
                    "cyclogram": cyclogram,
                    "inputs": named(found.inputs),
                    "weight decay": f"{decay:g}",
                    f"best of {len(test)} by test": found.best_test,
                    "chosen without test data": found.without_test_data,
                    "median": float(test.median()),
                    "MLPClassifier, best of five": float(mlp.max()) if cyclogram == TAKEOFF else "–",
                    "its median": float(np.median(mlp)) if cyclogram == TAKEOFF else "–",
                }
            )
    return pd.DataFrame(rows).sort_values(["cyclogram", "inputs"], ascending=[False, True])


def statement_table(findings: Findings) -> pd.DataFrame:
    """Return the paper's statements on its networks, what the take-off shows, and the verdict."""
    rows: dict[str, dict[float, tuple[bool, str]]] = {}
    for (cyclogram, decay), (twelve, four, _) in findings.decays.items():
        if cyclogram == TAKEOFF:
            smaller = findings.subsets_of_four[decay]
            for statement, shown in _judged(twelve, four, smaller).items():
                rows.setdefault(statement, {})[decay] = shown
    return pd.DataFrame(
        [
            {"the paper says": statement}
            | {f"decay {decay:g}": text for decay, (_, text) in shown.items()}
            | {"verdict": _verdict([right for right, _ in shown.values()], "weight decay")}
            for statement, shown in rows.items()
        ]
    )


def _judged(
    twelve: Experiment, four: Experiment, subsets: dict[tuple[str, ...], float]
) -> dict[str, tuple[bool, str]]:
    """Return whether each statement holds, and the figure that shows it."""
    best, other, gain = twelve.best_test, four.best_test, four.best_test - twelve.best_test
    whole = subsets[SELECTED]
    inputs, without = max(((s, x) for s, x in subsets.items() if s != SELECTED), key=lambda one: one[1])
    time = four.seconds / twelve.seconds
    neurons = [int(table["hidden"].iloc[table["test"].argmax()]) for table in (twelve.table, four.table)]
    accuracy = four.flights.set_index("friction_nm")["per_sample"]
    lowest = all(accuracy[limit] <= accuracy[list(others)].min() for limit, others in _NEAREST)
    return {
        f"V1–V12 reach {BEST_12:.2f} %": (abs(best - BEST_12) <= POINT, f"{best:.2f}"),
        f"V2 V5 V9 V11 reach {BEST_SELECTED:.2f} %": (abs(other - BEST_SELECTED) <= POINT, f"{other:.2f}"),
        f"these four gain {BEST_SELECTED - BEST_12:.2f} points": (gain >= POINT, f"{gain:+.2f}"),
        "the maximum needs all four": (
            whole - without >= POINT,
            f"{whole - without:+.2f} on {' '.join(inputs)}",
        ),
        "four learn significantly faster": (time <= FASTER, f"{time:.2f} of the time"),
        "fewer neurons suffice (16, then 14)": (neurons[1] < neurons[0], "{}, then {}".format(*neurons)),
        "accuracy is lowest at 0.375 and 0.875 N·m": (lowest, "yes" if lowest else "no"),
    }


def group_statement(groups: pd.DataFrame) -> str:
    """Return the verdict on the paper's four groups, from which it selects V2, V5, V9 and V11."""
    paper = groups["cyclogram"] == TAKEOFF
    right = (groups["number"] == len(SELECTED)) & (groups["selected"] == ", ".join(SELECTED))
    return _verdict(right[paper].tolist(), "settings of the filter")


def _verdict(right: list[bool], setting: str) -> str:
    if len(set(right)) == 1:
        return "confirmed" if right[0] else "not confirmed"
    return f"depends on the {setting}"


def named(inputs: tuple[str, ...]) -> str:
    """Return the names of inputs."""
    return " ".join(inputs) if inputs != KEYS else "V1–V12"
