"""Accuracy, abstention and calibration of the packaged networks on unseen flights.

    python benchmarks/networks.py [--flights 4] [--part PART]

Individuals with two masses, four actuators a flight, flights of 100 s at 100 Hz unless said otherwise,
from seeds that neither training nor calibration used. Windows are of 10 s and do not overlap. The
networks were trained and calibrated on all six modes.

cards       what the packaged networks' cards say
windows     every condition that the simulator flies: decisions by condition, severity, mode and rate
independent logs of flights unlike those of training, with the network as the judge, by window and actuator;
            --last-look takes seeds that are kept for the end
stages      what each stage of the paper's scheme is worth: results with one stage more at a time
bound       what a decision per sample can reach: boosted trees on more and more flights, and with the slope
            of the speed, which is in none of V1…V12, beside them
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from time import process_time

import numpy as np
from rich.console import Console
from rich.table import Table
from sklearn.ensemble import HistGradientBoostingClassifier

from benchmarks import _independent
from benchmarks._windows import NAMES, windows
from mavhums.actuator.profile import load_airframe
from mavhums.core.quantities import KEYS, column
from mavhums.health.estimation.motion import motion
from mavhums.health.estimation.slots import SlotCutter, with_extra_columns
from mavhums.learn import (
    Model,
    Scheme,
    TrainingOptions,
    packaged_models,
    train_network,
)
from mavhums.paper.flights import TELEMETRY, ActuatorFlight, Fleet, Telemetry, fly_fleet, moving_samples
from mavhums.paper.flights import windows as votes_of
from mavhums_sim.manoeuvres import CYCLOGRAMS

SEED = 50_000_000
ERROR = "expected_calibration_error"
EACH = 14  # independent flights
PARTS = ["cards", "windows", "independent", "stages", "bound"]
ACTUATOR = load_airframe("paper").actuators[2]
MIDDLE = 0.625
CLASSES = ((0.225, 0.375), (0.875, 1.025))

Range = tuple[float, float]


def fleet(
    telemetry: Telemetry,
    friction: Range,
    flights: int,
    part: int,
    cyclograms: Sequence[str],
) -> Iterable[ActuatorFlight]:
    frictions = np.random.default_rng([SEED, part]).uniform(*friction, (flights, 4))
    seed = SEED + 10_000 * part
    return fly_fleet(Fleet(ACTUATOR, telemetry, seed, cyclograms), frictions)


class Tally:
    """Windows of several flights: predictions and truth."""

    def __init__(self, model: Model) -> None:
        uncalibrated = model.card.model_copy(update={"calibration": None})
        self.model, self._bare = model, Model(model.network, uncalibrated, "")
        self.right = self.samples = 0
        self.share: list[float] = []
        self.friction: list[float] = []

    def take(self, flown: ActuatorFlight) -> None:
        moving, _ = moving_samples(ACTUATOR, flown)
        votes = self.model.votes(moving)
        self.right += int(np.count_nonzero(votes[votes >= 0] == (flown.friction_nm > MIDDLE)))
        self.samples += int(np.count_nonzero(votes >= 0))
        for found, _ in votes_of(ACTUATOR, [self._bare], flown):
            if found:
                self.share.append(found.p_fault)
                self.friction.append(flown.friction_nm)

    @property
    def event(self) -> np.ndarray:
        return np.array(self.friction) > MIDDLE

    @property
    def right_share(self) -> float:
        return float(np.mean((np.array(self.share) > 0.5) == self.event)) if self.share else np.nan


def table(*titles: str) -> Table:
    made = Table(box=None, header_style="bold", pad_edge=False)
    for k, title in enumerate(titles):
        made.add_column(title, justify="right" if k > 1 else "left")
    return made


def cards(models: dict[str, Model]) -> None:
    """Print what the cards of the networks of samples say."""
    print("| network | inputs | samples right | windows right | windows abstained | calibration error |")
    print("|---" * 6 + "|")
    for name, model in models.items():
        card = model.card
        assert card.calibration is not None
        shares = ("samples_in_motion_right", "windows_right", "windows_in_motion_abstained")
        cells = [" ".join(card.features), *(f"{100 * card.metrics[share]:.1f} %" for share in shares)]
        print(f"| {NAMES[name]} | {' | '.join(cells)} | {card.calibration.metrics[ERROR]:.3f} |")


STAGES = {
    "one network on everything": Scheme(select="none", vectors=None, networks=1),
    "fifty networks": Scheme(select="none", vectors=None),
    "and 4,000 vectors": Scheme(select="none"),
    "and Algorithm 1, R² 0.99": Scheme(r2=0.99),
    "and Algorithm 1, R² 0.999: the paper's chain": Scheme(),
    "pairs instead": Scheme(select="pairwise"),
    "a genetic search instead": Scheme(select="genetic"),
}


def stages(models: dict[str, Model], flights: int) -> Table:
    """Train with one stage more at a time; print correct samples and windows on flights of all modes."""
    rows = table("model", "stages", "inputs", "samples right", "windows right, share", "CPU s")
    for name, packaged in models.items():
        telemetry = TELEMETRY[name]
        data = samples_of(telemetry, 3 * flights)
        tested = [
            flown
            for j, friction in enumerate(CLASSES)
            for flown in fleet(telemetry, friction, 3 * flights, 200 + j, [*CYCLOGRAMS])
        ]
        for title, scheme in STAGES.items():
            begin = process_time()
            result = train_network(*data, TrainingOptions(1, telemetry.keys, scheme))
            seconds = process_time() - begin
            tally = Tally(replace(packaged, network=result.network))
            for flown in tested:
                tally.take(flown)
            rows.add_row(
                name,
                title,
                " ".join(result.network.keys),
                f"{100 * tally.right / tally.samples:.2f}",
                f"{100 * tally.right_share:.2f}",
                f"{seconds:.0f}",
            )
    return rows


def samples_of(telemetry: Telemetry, flights: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    inputs = [column(key) for key in telemetry.keys]
    values, labels, numbers = [], [], []
    for label, friction in enumerate(CLASSES):
        for flown in fleet(telemetry, friction, flights, 100 + label, [*CYCLOGRAMS]):
            moving, _ = moving_samples(ACTUATOR, flown)
            kept = moving[np.isfinite(moving[:, inputs]).all(axis=1)][::20]
            values.append(kept)
            labels.append(np.full(len(kept), bool(label)))
            numbers.append(np.full(len(kept), 1000 * label + flown.flight))
    return np.concatenate(values), np.concatenate(labels), np.concatenate(numbers)


def bound(flights: int) -> Table:
    """Learn the classes of single samples by trees from more and more flights; other flights test them.

    Trees on all quantities of a tier, from individuals, loads and noise drawn as in the test, approach the
    classifier that knows these distributions; where more flights no longer help, they have reached it.
    """
    rows = table("tier", "quantities", "flights of each class", "samples in motion right", *CYCLOGRAMS)
    for telemetry in TELEMETRY.values():
        tested = motion_samples(telemetry, 3 * flights, 300)
        learned = motion_samples(telemetry, 12 * flights, 310)
        for slope in (False, True):
            columns = [column(key) for key in telemetry.keys] + ([len(KEYS)] if slope else [])
            for share in (4, 1):
                mine = learned[learned[:, -2] < 12 * flights // share]
                trees = HistGradientBoostingClassifier(max_iter=200, max_leaf_nodes=63, min_samples_leaf=100)
                trees.fit(mine[:, columns], mine[:, -3])
                right = trees.predict(tested[:, columns]) == tested[:, -3]
                rows.add_row(
                    telemetry.name,
                    "and the slope of V7" if slope else "V1…V12 of the tier",
                    str(12 * flights // share),
                    f"{100 * right.mean():.2f} %",
                    *(f"{100 * right[tested[:, -1] == k].mean():.1f}" for k in range(len(CYCLOGRAMS))),
                )
    return rows


def motion_samples(telemetry: Telemetry, flights: int, part: int) -> np.ndarray:
    """Return V1…V12, the shaft's acceleration, class, flight and mode of every fifth sample, (n, 16)."""
    inputs, parts = [column(key) for key in telemetry.keys], []
    for label, friction in enumerate(CLASSES):
        for flown in fleet(telemetry, friction, flights, part + label, [*CYCLOGRAMS]):
            slots = SlotCutter().feed(flown.time_s, with_extra_columns(flown.values))
            assert slots is not None
            seen = motion(ACTUATOR, slots)
            said = (label, flown.flight, [*CYCLOGRAMS].index(flown.cyclogram))
            columns = (np.full(len(seen.values), each) for each in said)
            rows = np.column_stack([seen.values, seen.acceleration, *columns])[seen.moving]
            parts.append(rows[np.isfinite(rows[:, inputs]).all(axis=1)][::5])
    return np.concatenate(parts)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flights", type=int, default=4, help="of each class and mode; four actuators each")
    parser.add_argument("--part", choices=PARTS)
    parser.add_argument("--last-look", action="store_true", help="independent: the seeds of the last look")
    options = parser.parse_args()
    console = Console(width=150)
    models = dict(zip(TELEMETRY, packaged_models(), strict=True))
    looked = _independent.LAST_LOOK if options.last_look else _independent.SEED
    parts: dict[str, Callable[[], Table | None]] = {
        "cards": lambda: cards(models),
        "windows": lambda: windows(models, options.flights),
        "independent": lambda: _independent.independent([*models.values()], EACH * options.flights, looked),
        "stages": lambda: stages(models, options.flights),
        "bound": lambda: bound(options.flights),
    }
    for name, part in parts.items():
        if options.part in (None, name):
            console.print(f"\n[bold]{name}[/]\n")
            if made := part():
                console.print(made)


if __name__ == "__main__":
    main()
