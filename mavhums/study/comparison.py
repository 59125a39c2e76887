"""The study's first table: the paper's accuracies beside ours on both cyclograms, and what differs."""

from __future__ import annotations

import pandas as pd

from mavhums.core.quantities import KEYS
from mavhums.study.cyclograms import MAIN, TAKEOFF
from mavhums.study.experiment import Bound
from mavhums.study.findings import TWO, Findings
from mavhums.study.published import BEST_12, BEST_SELECTED, SELECTED

__all__ = ["differences", "first_table"]


def first_table(findings: Findings, cyclogram: str) -> pd.DataFrame:
    """Return a row for each set of inputs on one cyclogram."""
    chosen = findings.groupings[cyclogram]
    names = {
        TWO: "two",
        chosen.pairwise_selected: "selected in pairs",
        SELECTED: "the paper's",
        chosen.selected: "selected by Algorithm 1",
        KEYS: "all",
    }
    rows = []
    for found in findings.experiments[cyclogram]:
        paper = BEST_12 if found.inputs == KEYS else BEST_SELECTED
        best = float(found.table["test"].max())
        rows.append(
            {
                "cyclogram": cyclogram,
                "inputs": f"{names[found.inputs]}: {_named(found.inputs)}",
                "paper, best of 50 by test, %": paper,
                f"ours, best of {len(found.table)} by test, %": best,
                "reaches the paper's": "yes" if best >= paper else "no",
                "ours, chosen without test data, %": found.without_test_data,
            }
        )
    return pd.DataFrame(rows)


def differences(findings: Findings) -> str:
    """Return what contradicts the paper, a sentence each, with its figures."""
    lines = []
    for name in (TAKEOFF, MAIN):
        by_inputs = {found.inputs: found for found in findings.experiments[name]}
        twelve, theirs, two = (by_inputs[inputs] for inputs in (KEYS, SELECTED, TWO))
        best = [float(found.table["test"].max()) for found in (twelve, theirs, two)]
        speed = theirs.seconds / twelve.seconds
        lines += [
            f'- "{name}": the paper\'s four inputs gain {best[1] - best[0]:+.2f} points on all twelve '
            f"(paper: {BEST_SELECTED - BEST_12:+.2f}).",
            f'- "{name}": learning with four inputs takes {speed:.2f} times as long as with twelve; '
            "the paper says that it is significantly faster.",
            f'- "{name}": {_named(TWO)} alone reach {best[2]:.2f} %; '
            "the paper says that the maximum needs all four.",
        ]
    if findings.bound:
        lines.append(f"- {_bound(findings.bound)}")
    return "What differs from the paper:\n\n" + "\n".join(lines)


def _bound(bound: Bound) -> str:
    # The share of the samples at rest that the paper's best needs, all others being right, %.
    needed = (BEST_SELECTED - 100 * bound.moving_share) / (1 - bound.moving_share)
    return (
        f"Why the paper's {BEST_SELECTED} % is hardly reached on the take-off: an oracle that learned "
        f"{bound.takeoffs} other take-offs at the test frictions themselves classifies "
        f"{100 * bound.all:.2f} % of the 60,000 test samples right, {100 * bound.moving:.2f} % of those in "
        f"motion and {100 * bound.standing:.2f} % of the {100 * (1 - bound.moving_share):.1f} % at rest. "
        f"{BEST_SELECTED} % needs {needed:.1f} % of those at rest from two training frictions alone."
    )


def _named(inputs: tuple[str, ...]) -> str:
    return ", ".join(inputs) if inputs != KEYS else "V1–V12"
