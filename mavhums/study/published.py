"""The numbers that the paper publishes, under the paper's names."""

from __future__ import annotations

from typing import Final, NamedTuple

__all__ = [
    "BEST_12",
    "BEST_SELECTED",
    "CHI_SQUARE",
    "CONDITIONS",
    "FIGURES_16_TO_19",
    "P_LEVELS",
    "SELECTED",
    "TABLE_1",
    "TABLE_4",
    "TABLE_5",
    "TEST_NM",
    "TRAINING_NM",
    "PublishedNetwork",
]

TABLE_1: Final = {
    "nominal torque, N·m": 3.5,
    "stall torque, N·m": 5.0,
    "no-load rotation speed, °/s": 100.0,
    "output stroke, ± °": 60.0,
    "supply voltage, V": 27.0,
    "nominal current, A": 0.85,
    "mass, kg": 0.36,
}

TRAINING_NM: Final = (0.225, 1.025)
TEST_NM: Final = (0.275, 0.325, 0.375, 0.875, 0.925, 0.975)
CONDITIONS: Final = (0.225, 0.275, 0.325, 0.375, 0.875, 0.925, 0.975, 1.025)
"""The second table 1 lists 1.025 as a test condition; the text and figures 16 to 19 train on it."""

FIGURES_16_TO_19: Final = {16: 0.225, 17: 0.375, 18: 1.025, 19: 0.875}
"""The friction of each figure, N·m."""

SELECTED: Final = ("V2", "V5", "V9", "V11")


class PublishedNetwork(NamedTuple):
    """A network of table 4 or 5: hidden neurons and accuracies, %."""

    hidden: int
    training: float
    test: float


TABLE_4: Final = (
    PublishedNetwork(11, 98.73, 93.96167),
    PublishedNetwork(16, 99.38, 96.70167),
    PublishedNetwork(12, 95.07, 92.41167),
    PublishedNetwork(11, 98.30, 95.02167),
    PublishedNetwork(10, 99.98, 94.79),
)
TABLE_5: Final = (
    PublishedNetwork(14, 99.985, 98.01),
    PublishedNetwork(15, 99.045, 95.14333),
    PublishedNetwork(11, 96.685, 95.405),
    PublishedNetwork(16, 99.79, 96.70667),
    PublishedNetwork(11, 96.68, 94.00167),
)
BEST_12: Final = 96.70
BEST_SELECTED: Final = 98.01

CHI_SQUARE: Final = {
    "V1": 40590.56,
    "V2": 41807.30,
    "V3": 41807.30,
    "V4": 19272.22,
    "V5": 19452.68,
    "V6": 14806.20,
    "V7": 115.80,
    "V8": 19452.68,
    "V9": 1811.61,
    "V10": 115.80,
    "V11": 10.22,
    "V12": 26.56,
}
P_LEVELS: Final = {"V11": 0.009165, "V12": 0.005362}
"""P-levels in figure 15; the paper gives the others as 0.000000."""
