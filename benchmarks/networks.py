"""Accuracy, abstention and calibration of the packaged networks on unseen flights.

    python benchmarks/networks.py [--flights 4] [--part PART]

Individuals with two masses, four actuators a flight, flights of 100 s at 100 Hz unless said otherwise,
from seeds that neither training nor calibration used. Windows are of 10 s and do not overlap. The
networks were trained and calibrated on all six modes.

modes       normal (0.225 … 0.375 N·m) and emergency (0.875 … 1.025 N·m), each flight mode by itself
population  frictions through the whole range at 100, 50, 25 and 10 Hz: Brier score and calibration
faults      windows between the classes, and with other faults: who abstains, and what is said
windows     every condition that the simulator flies: decisions by condition, severity, mode and rate
independent logs of flights unlike those of training, with the network as the judge, by window and actuator;
            --last-look takes seeds that are kept for the end
stages      what each stage of the paper's scheme is worth: results with one stage more at a time
bound       what a decision per sample can reach: boosted trees on more and more flights, and with the slope
            of the speed, which is in none of V1…V12, beside them
cost        processor time to count the votes of 6,000 samples
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
from mavhums.actuator import load_airframe
from mavhums.core.quantities import KEYS, column
from mavhums.health.actuator.votes import count_votes
from mavhums.health.estimation.motion import motion
from mavhums.health.estimation.slots import SlotCutter, with_extra_columns
from mavhums.learn import (
    Model,
    Scheme,
    brier_score,
    expected_calibration_error,
    packaged_models,
    train_network,
)
from mavhums.paper.flights import TELEMETRY, ActuatorFlight, Telemetry, fly_fleet, moving_samples
from mavhums.paper.flights import windows as votes_of
from mavhums_sim.conditions import Condition
from mavhums_sim.manoeuvres import CYCLOGRAMS

SEED = 50_000_000
ERROR = "expected_calibration_error"
EACH = 14  # independent flights
PARTS = ["modes", "population", "faults", "windows", "independent", "stages", "bound", "cost"]
ACTUATOR = load_airframe("paper").actuators[2]
MIDDLE = 0.625
CLASSES = ((0.225, 0.375), (0.875, 1.025))
FAULTS = {
    "between the classes": ((0.375, 0.875), ()),
    "normal, resistance +20 %": (CLASSES[0], (Condition.constant("resistance", 0.20),)),
    "emergency, resistance +20 %": (CLASSES[1], (Condition.constant("resistance", 0.20),)),
    "normal, resistance +100 %": (CLASSES[0], (Condition.constant("resistance", 1.0),)),
    "normal, torque constant −10 %": (CLASSES[0], (Condition.constant("torque_constant", 0.10),)),
    "emergency, torque constant −10 %": (CLASSES[1], (Condition.constant("torque_constant", 0.10),)),
    "normal, supply −6 V": (CLASSES[0], (Condition.constant("supply_sag", 6.0),)),
    "normal, backlash +0.3°": (CLASSES[0], (Condition.constant("backlash", 0.3),)),
}

Range = tuple[float, float]


def fleet(
    telemetry: Telemetry,
    friction: Range,
    flights: int,
    part: int,
    cyclograms: Sequence[str],
    conditions: tuple[Condition, ...] = (),
    rates_hz: Sequence[float] = (100.0,),
) -> Iterable[ActuatorFlight]:
    frictions = np.random.default_rng([SEED, part]).uniform(*friction, (flights, 4))
    seed = SEED + 10_000 * part
    return fly_fleet(
        ACTUATOR,
        telemetry,
        frictions,
        seed=seed,
        cyclograms=cyclograms,
        rates_hz=rates_hz,
        conditions=conditions,
    )


class Tally:
    """Windows of several flights: predictions and truth."""

    def __init__(self, model: Model) -> None:
        uncalibrated = model.card.model_copy(update={"calibration": None})
        self.model, self._bare = model, Model(model.network, uncalibrated, "")
        self.right = self.samples = self.windows = self.still = 0
        self.share: list[float] = []
        self.friction: list[float] = []

    def take(self, flown: ActuatorFlight) -> None:
        moving, _ = moving_samples(ACTUATOR, flown)
        votes = self.model.votes(moving)
        self.right += int(np.count_nonzero(votes[votes >= 0] == (flown.friction_nm > MIDDLE)))
        self.samples += int(np.count_nonzero(votes >= 0))
        for found, count in votes_of(ACTUATOR, [self._bare], flown):
            self.windows += 1
            self.still += count < 20
            if found:
                self.share.append(found.p_fault)
                self.friction.append(flown.friction_nm)

    @property
    def event(self) -> np.ndarray:
        return np.array(self.friction) > MIDDLE

    @property
    def said(self) -> np.ndarray:
        return np.array([self.model.probability(share) for share in self.share])

    def right_share(self, said: Sequence[float] | np.ndarray) -> float:
        return float(np.mean((np.asarray(said) > 0.5) == self.event)) if len(self.share) else np.nan

    @property
    def abstained(self) -> str:
        """Values for windows with at least twenty moving samples; in brackets, for those with fewer."""
        working = self.windows - self.still
        kept = len(self.share)
        return f"{percent(max(working - kept, 0) / max(working, 1))} ({percent(self.still / self.windows)})"


def percent(part: float) -> str:
    return "—" if np.isnan(part) else f"{100 * part:.1f} %"


def table(*titles: str) -> Table:
    made = Table(box=None, header_style="bold", pad_edge=False)
    for k, title in enumerate(titles):
        made.add_column(title, justify="right" if k > 1 else "left")
    return made


def modes(models: dict[str, Model], flights: int) -> None:
    """Print what the cards say, then samples / windows right by network and mode."""
    print("| network | inputs | samples right | windows right | windows abstained | calibration error |")
    print("|---" * 6 + "|")
    for name, model in models.items():
        card = model.card
        assert card.calibration is not None
        shares = ("samples_in_motion_right", "windows_right", "windows_in_motion_abstained")
        cells = [" ".join(card.features), *(f"{100 * card.metrics[share]:.1f} %" for share in shares)]
        print(f"| {NAMES[name]} | {' | '.join(cells)} | {card.calibration.metrics[ERROR]:.3f} |")
    print()
    print(f"| network | {' | '.join(CYCLOGRAMS)} |")
    print("|---" * (1 + len(CYCLOGRAMS)) + "|")
    idle = []
    for name, model in models.items():
        cells = []
        for k, mode in enumerate(CYCLOGRAMS):
            tally = Tally(model)
            for j, friction in enumerate(CLASSES):
                for flown in fleet(TELEMETRY[name], friction, flights, 1 + 2 * k + j, [mode]):
                    tally.take(flown)
            right = 100 * tally.right / tally.samples
            cells.append(f"{right:.1f} / {100 * tally.right_share(tally.share):.1f} %")
            idle.append(f"{name}, {mode}: abstains (still) {tally.abstained} of {tally.windows} windows")
        print(f"| {NAMES[name]} | {' | '.join(cells)} |", flush=True)
    print("", *idle, sep="\n")


def population(models: dict[str, Model], flights: int) -> Table:
    rows = table(
        "model",
        "rates",
        "Brier, share",
        "Brier",
        "ECE, share",
        "ECE",
        "right",
        "p < 0.1 or > 0.9",
        "wrong there",
    )
    for name, model in models.items():
        for rates in ((100.0, 50.0, 25.0, 10.0), (100.0,), (10.0,)):
            tally = Tally(model)
            for flown in fleet(
                TELEMETRY[name], (0.225, 1.025), 12 * flights, 30, [*CYCLOGRAMS], rates_hz=rates
            ):
                tally.take(flown)
            said, event = tally.said, tally.event
            sure = (said < 0.1) | (said > 0.9)
            rows.add_row(
                name,
                ", ".join(f"{rate:g}" for rate in rates),
                *(f"{score(p, event):.4f}" for score in (brier_score, expected_calibration_error)
                  for p in (tally.share, said)),
                percent(tally.right_share(said)),
                percent(float(sure.mean())),
                percent(float(np.mean((said > 0.5)[sure] != event[sure]))),
            )  # fmt: skip
    return rows


def faults(models: dict[str, Model], flights: int) -> Table:
    rows = table(
        "model", "windows", "abstains (still)", "p < 0.1", "0.1 … 0.9", "p > 0.9", "wrong by more than 0.9"
    )
    for name, model in models.items():
        for k, (title, (friction, conditions)) in enumerate(FAULTS.items()):
            tally = Tally(model)
            for flown in fleet(
                TELEMETRY[name], friction, 6 * flights // 2, 50 + k, [*CYCLOGRAMS], conditions
            ):
                tally.take(flown)
            said, event = tally.said, tally.event
            wrong = np.where(event, said < 0.1, said > 0.9)
            shares = (said < 0.1, (said >= 0.1) & (said <= 0.9), said > 0.9, wrong)
            rows.add_row(
                name, title, tally.abstained, *(percent(float(part.mean())) for part in shares)
            )  # fmt: skip
    return rows


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
            result = train_network(*data, seed=1, keys=telemetry.keys, scheme=scheme)
            seconds = process_time() - begin
            tally = Tally(replace(packaged, network=result.network))
            for flown in tested:
                tally.take(flown)
            rows.add_row(
                name,
                title,
                " ".join(result.network.keys),
                f"{100 * tally.right / tally.samples:.2f}",
                f"{100 * tally.right_share(tally.share):.2f}",
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


def cost(models: dict[str, Model]) -> Table:
    rows = table("model", "hidden", "CPU ms, one call", "CPU ms, a call a second", "one second's call, µs")
    for name, model in models.items():
        flown = next(iter(fleet(TELEMETRY[name], CLASSES[0], 1, 90, ["takeoff"])))
        moving = np.resize(moving_samples(ACTUATOR, flown)[0], (6000, 12))
        each = [moving[start : start + 100] for start in range(0, 6000, 100)]
        edges = np.arange(0, 6001, 100)

        def timed(run: object, repeats: int = 20) -> float:
            times = []
            for _ in range(repeats):
                begin = process_time()
                run()  # type: ignore[operator]
                times.append(process_time() - begin)
            return 1e3 * float(np.median(times))

        networks = [*models.values()]
        at_once = timed(lambda: count_votes(networks, moving, edges, 300.0))  # noqa: B023
        singly = timed(lambda: [count_votes(networks, part, (0, 100), 300.0) for part in each])  # noqa: B023
        hidden = str(len(model.network.b1))
        rows.add_row(name, hidden, f"{at_once:.2f}", f"{singly:.2f}", f"{1e3 * singly / 60:.0f}")
    return rows


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
        "modes": lambda: modes(models, options.flights),
        "population": lambda: population(models, options.flights),
        "faults": lambda: faults(models, options.flights),
        "windows": lambda: windows(models, options.flights),
        "independent": lambda: _independent.independent([*models.values()], EACH * options.flights, looked),
        "stages": lambda: stages(models, options.flights),
        "bound": lambda: bound(options.flights),
        "cost": lambda: cost(models),
    }
    for name, part in parts.items():
        if options.part in (None, name):
            console.print(f"\n[bold]{name}[/]\n")
            if made := part():
                console.print(made)


if __name__ == "__main__":
    main()
