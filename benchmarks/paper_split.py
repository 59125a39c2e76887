"""Per-sample accuracy of one network on the paper's split of conditions.

    python benchmarks/paper_split.py

Trains on T_c = 0.225 and 1.025 N·m and tests on the other six, each a flight of 100 s at 100 Hz with
a cyclogram of its own, sensors without noise as in the paper's model. Of several networks the best
one on every fourth block of five seconds, held out of the two training flights, is used; the test
flights do not affect the choice.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from mavhums.core.quantities import KEYS, column
from mavhums.learn import TanhNetworkClassifier, select_features
from mavhums_sim import Flight, fly
from mavhums_sim.campaign import PAPER_FRICTION_NM
from mavhums_sim.sensors import SensorNoise

TRAINING = (0.225, 1.025)
TEST = tuple(friction for friction in PAPER_FRICTION_NM if friction not in TRAINING)
SURFACE = "elevator"
MOVING_REV_MIN = 50.0
BLOCK = 500
PAPER = {"all twelve": "96.70", "the paper's four": "98.01"}

Array = NDArray[np.float64]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--networks", type=int, default=10, help="networks to choose from")
    options = parser.parse_args()
    flown = {}
    for k, friction in enumerate(PAPER_FRICTION_NM):
        flight = Flight(seed=500 + k, friction_nm={SURFACE: (friction, friction)}, noise=SensorNoise.none())
        flown[friction] = fly(flight).actuators[SURFACE]
    values = np.concatenate([flown[friction].values for friction in TRAINING])
    label = np.repeat([False, True], [len(flown[friction].values) for friction in TRAINING])
    held_out = (np.arange(len(values)) // BLOCK) % 4 == 3
    selection = select_features(values[~held_out], label[~held_out])

    table = Table(box=None, header_style="bold", pad_edge=False)
    for title in ("inputs", "training", *map("{:.3f}".format, TEST), "test", "moving", "paper", "time, s"):
        table.add_column(title, justify="right" if table.columns else "left")
    table.add_row("moving fraction", "", *(f"{100 * flown[f].motion.moving_fraction:.1f}" for f in TEST))
    inputs = {
        "all twelve": KEYS,
        "selected": selection.selected,
        "the paper's four": ("V2", "V5", "V9", "V11"),
    }
    for name, keys in inputs.items():
        columns = [column(key) for key in keys]
        started = time.perf_counter()
        network = best(values[:, columns], label, held_out, options.networks)
        seconds = time.perf_counter() - started
        right = {f: network.predict(flown[f].values[:, columns]) == (f > 0.6) for f in TEST}
        moving = [np.abs(flown[f].values[:, column("V7")]) > MOVING_REV_MIN for f in TEST]
        in_motion = np.concatenate([right[f][m] for f, m in zip(TEST, moving, strict=True)])
        table.add_row(
            name if len(keys) == len(KEYS) else f"{name}: {' '.join(keys)}",
            percent(network.predict(values[:, columns]) == label),
            *(percent(right[f]) for f in TEST),
            percent(np.concatenate(list(right.values()))),
            percent(in_motion),
            PAPER.get(name, "—"),
            f"{seconds:.1f}",
        )
    Console(width=150).print(table)
    groups = ", ".join(f"{{{' '.join(group)}}}" for group in selection.groups)
    print(f"\ngroups of interdependent features: {groups}")
    print("chi-square: " + ", ".join(f"{key} {value:.0f}" for key, value in selection.chi_square.items()))


def best(
    features: Array, label: NDArray[np.bool_], held_out: NDArray[np.bool_], count: int
) -> TanhNetworkClassifier:
    networks = [TanhNetworkClassifier(hidden=4 + k % 13, random_state=k) for k in range(count)]
    for network in networks:
        network.fit(features[~held_out], label[~held_out])
    return max(networks, key=lambda network: network.score(features[held_out], label[held_out]))


def percent(right: NDArray[np.bool_]) -> str:
    return f"{100 * right.mean():.2f}"


if __name__ == "__main__":
    main()
