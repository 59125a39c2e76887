"""Experiments with fifty networks (tables 4 and 5, figures 16 to 19)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import process_time

import numpy as np
import pandas as pd

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.quantities import column
from mavhums.learn import TanhNetwork, TanhNetworkEnsemble
from mavhums.paper.cyclograms import (
    TEST_NM,
    TRAINING_NM,
    CyclogramSamples,
    fly_condition,
)

WEIGHT_DECAY = 1e-4
"""Of all networks but those of the table over weight decay; the paper names none."""

_EMERGENCY_NM = 0.5
_VOTES = 100


@dataclass(frozen=True)
class Effort:
    """Size of the study's computations.

    Attributes
    ----------
    networks, iterations
        Number of networks and of iterations in each experiment.
    every
        Decimation of the training samples: every n-th is used.
    """

    networks: int = 50
    iterations: int = 300
    every: int = 1

    @classmethod
    def quick(cls) -> Effort:
        """Return a size of one to two minutes."""
        return cls(networks=5, iterations=60, every=10)


def emergency(flown: CyclogramSamples) -> bool:
    """Return whether a condition belongs to the emergency class."""
    return flown.friction_nm > _EMERGENCY_NM


def samples(flights: Sequence[CyclogramSamples], every: int = 1) -> tuple[Array, Flags, Integers]:
    """Return V1…V12, class and flight index of the concatenated samples of several flights."""
    values = [flown.values[::every] for flown in flights]
    numbers = np.repeat(np.arange(len(flights)), [len(part) for part in values])
    return np.concatenate(values), np.array([emergency(flown) for flown in flights])[numbers], numbers


def held_decision(decisions: Flags, moving: Flags, votes: int = 1) -> tuple[Flags, Flags]:
    """Hold the last decision made in motion during standstill, causally.

    Parameters
    ----------
    decisions
        The network's decision at each sample, shape (n,).
    moving
        Whether the actuator moved, shape (n,).
    votes
        Number of latest moving samples whose majority decides.

    Returns
    -------
    NDArray, NDArray
        The decision, and whether one exists yet, shape (n,) each.
    """
    count = np.cumsum(moving)
    total = np.concatenate([[0], np.cumsum(decisions[moving])])
    since = np.maximum(count - votes, 0)
    decided = count > 0
    share = (total[count] - total[since]) / np.maximum(count - since, 1)
    return np.asarray(share > 0.5), np.asarray(decided)


@dataclass(frozen=True, eq=False)
class Experiment:
    """Results of fifty networks on one set of inputs.

    Attributes
    ----------
    cyclogram, inputs
        The cyclogram, and the networks' input quantities.
    table
        A row for each network: hidden, training and test accuracy in %, loss, iterations, and whether it is
        chosen, by the smallest training loss. The choice uses no test data.
    network
        The chosen network.
    ensemble_test, ensemble_spread
        Test accuracy of the mean of all networks, %, and the mean spread of their probabilities.
    seconds
        Processor time to train all networks, s; independent of other programs.
    flights
        A row for each flight: friction, role, moving fraction, and the chosen network's accuracies
        in %: per sample, held, and held with the majority of the last 100 moving samples.
    outputs
        The chosen network's probability of an emergency over each flight, by friction.
    """

    cyclogram: str
    inputs: tuple[str, ...]
    table: pd.DataFrame
    network: TanhNetwork
    ensemble_test: float
    ensemble_spread: float
    seconds: float
    flights: pd.DataFrame
    outputs: dict[float, Array]

    @property
    def best_test(self) -> float:
        """Best test accuracy of all networks, %: the paper's convention."""
        return float(self.table["test"].max())

    @property
    def iterations(self) -> float:
        """Mean number of iterations of a network."""
        return float(self.table["iterations"].mean())

    @property
    def without_test_data(self) -> float:
        """Test accuracy of the chosen network, %."""
        return float(self.table.loc[self.table["chosen"], "test"].iloc[0])

    def test_mean(self, name: str) -> float:
        """Return the mean over the test flights of a column of :attr:`flights`."""
        return float(self.flights.loc[self.flights["role"] == "test", name].mean())


def run_experiment(
    cyclogram: str,
    inputs: tuple[str, ...],
    effort: Effort,
    *,
    seed: int,
    load_friction: float = 0.0,
    weight_decay: float = WEIGHT_DECAY,
) -> Experiment:
    """Train networks on the paper's training flights and test them on its test flights.

    Parameters
    ----------
    cyclogram
        A key of :data:`~mavhums.paper.experiment.CYCLOGRAMS`.
    inputs
        Keys of the networks' input quantities.
    effort, seed
        Size of the computation, and random seed.
    load_friction
        μ of the actuator.
    weight_decay
        Of the networks; see :class:`~mavhums.learn.TanhNetworkEnsemble`.
    """
    columns = [column(key) for key in inputs]
    training, test = (fly_condition(cyclogram, several, load_friction) for several in (TRAINING_NM, TEST_NM))
    values, classes, _ = samples(training, effort.every)
    ensemble = TanhNetworkEnsemble(
        effort.networks,
        weight_decay=weight_decay,
        max_iter=effort.iterations,
        n_jobs=2,
        random_state=seed,
    )
    begin = process_time()
    ensemble.fit(values[:, columns], classes)
    seconds = process_time() - begin

    def member_scores(flights: Sequence[CyclogramSamples]) -> Array:
        every, truth, _ = samples(flights)
        return 100 * ensemble.member_scores(every[:, columns], truth)

    together = [(ensemble.predict(part.values[:, columns]) == emergency(part)).mean() for part in test]
    spread = [ensemble.spread(part.values[::10, columns]).mean() for part in test]
    table = pd.DataFrame(
        {
            "hidden": [len(network.b1) for network in ensemble.networks_],
            "training": member_scores(training),
            "test": member_scores(test),
            "loss": ensemble.losses_,
            "iterations": ensemble.n_iter_,
            "chosen": np.arange(effort.networks) == ensemble.best_,
        }
    )
    network = ensemble.networks_[ensemble.best_]
    judged = [_judge(network, part, columns) for part in (*training, *test)]
    flights = pd.DataFrame([row for row, _ in judged]).sort_values("friction_nm", ignore_index=True)
    return Experiment(
        cyclogram=cyclogram,
        inputs=inputs,
        table=table,
        network=network,
        ensemble_test=100 * float(np.mean(together)),
        ensemble_spread=float(np.mean(spread)),
        seconds=seconds,
        flights=flights,
        outputs={part.friction_nm: p for part, (_, p) in zip((*training, *test), judged, strict=True)},
    )


def _judge(
    network: TanhNetwork, flown: CyclogramSamples, columns: list[int]
) -> tuple[dict[str, float | str], Array]:
    probability = network.p_first(flown.values[:, columns])
    decisions, truth = probability > 0.5, emergency(flown)
    row: dict[str, float | str] = {
        "friction_nm": flown.friction_nm,
        "role": "training" if flown.friction_nm in TRAINING_NM else "test",
        "moving_fraction": flown.moving_fraction,
        "per_sample": 100 * float((decisions == truth).mean()),
    }
    for name, votes in (("held", 1), ("voted", _VOTES)):
        decision, decided = held_decision(decisions, flown.moving, votes)
        row[name] = 100 * float((decision[decided] == truth).mean())
        row["before_motion"] = int((~decided).sum())
    return row, probability
