"""The networks' evidence: the class of each window, with its probability.

A network of windows gives it from their statistics. Where a model has none, or a log lacks a quantity that
it needs, the votes of the moving samples give the probability of an emergency by friction.

The first network whose input quantities the samples carry is used. Votes are counted separately for
the two directions of motion, because a load that is unknown to a network assists in one direction as
much as it opposes in the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.quantities import WINDOW_KEYS, column, of_window, shows_something, window_features
from mavhums.health.estimation.thresholds import LEAST_SAMPLES
from mavhums.learn import Model
from mavhums.learn.model import FRICTION_EMERGENCY
from mavhums.results.verdict import ABSTAINED, OUTSIDE

_V7, _V10 = column("V7"), column("V10")
ANGLES = [column("V2"), column("V3")]
"""Columns of the two angles of V1…V12."""

Counts = Integers


class Classifier(Protocol):
    """The interface of a network."""

    @property
    def keys(self) -> tuple[str, ...]:
        """The network's input quantities."""
        ...

    def votes(self, values: Array) -> NDArray[np.int8]:
        """Return 1 for an emergency, 0 for none, -1 outside the training range; V1…V12 (n, 12) to (n,)."""
        ...

    def probability(self, share: float) -> float:
        """Return the probability of an emergency for a window's share of votes."""
        ...

    @property
    def window_classes(self) -> tuple[str, ...]:
        """The conditions of :meth:`classify_windows`; empty without a network of windows."""
        ...

    @property
    def window_level(self) -> float:
        """Probability from which a window is decided."""
        ...

    def classify_windows(self, features: Array) -> tuple[Array, Flags]:
        """Return the probability of each condition, and which windows lie in the training range."""
        ...


class Ballot(NamedTuple):
    """Columns of the rows that :func:`count_votes` returns."""

    network: int = 0  # index of the network that voted; -1 for none
    moving: int = 1
    voters: slice = slice(2, 4)  # backward and forward
    emergency: slice = slice(4, 6)


_BALLOT = Ballot()


VOTE_COLUMNS = 6
"""Number of columns that :func:`count_votes` returns."""


class VoteOutcome(NamedTuple):
    """What a network says of a window.

    Attributes
    ----------
    network
        Index of the network that answered.
    said
        The most probable class; ``ABSTAINED`` below the probability from which the network decides,
        ``OUTSIDE`` where the window lies outside the training range.
    likely
        The most probable class.
    severity
        The gravest condition that the probabilities make sure of: 0 normal, 1 degraded, 2 an emergency; -1
        where none is, or outside.
    leaning
        The gravest condition that is likelier than not.
    probability, p_fault
        Probability of the most probable class, and of all classes but *normal*; no evidence outside.
    """

    network: int
    said: str
    likely: str
    severity: int
    leaning: int
    probability: float
    p_fault: float


def by_votes(p_emergency: float, network: int) -> VoteOutcome:
    """Return what a network of samples says of a window: it knows two classes."""
    if p_emergency > 0.5:
        return VoteOutcome(network, FRICTION_EMERGENCY, FRICTION_EMERGENCY, 2, 2, p_emergency, p_emergency)
    return VoteOutcome(network, "normal", "normal", 0, 0, 1.0 - p_emergency, p_emergency)


def count_votes(
    networks: Sequence[Classifier],
    moving: Array,
    bounds: ArrayLike,
) -> Counts:
    """Count the networks' votes on the moving samples of one or several slots.

    Parameters
    ----------
    networks
        Networks; the one with the most inputs comes first. A slot uses the first network whose
        quantities at least half of its samples carry.
    moving
        What :func:`network_inputs` returns of the slots' moving samples, concatenated, shape (n, 12).
    bounds
        Start of each slot in ``moving``, and end of the last one, shape (slots + 1,).

    Returns
    -------
    NDArray
        Shape (slots, 6); the columns are those of :class:`Ballot`. A slot's row does not depend on
        the other slots of the call.
    """
    edges = np.asarray(bounds, dtype=np.int64)
    sizes = np.diff(edges)
    counts = np.zeros((len(sizes), VOTE_COLUMNS), dtype=np.int64)
    counts[:, _BALLOT.network] = -1
    counts[:, _BALLOT.moving] = sizes
    carried = np.isfinite(moving)
    for k, network in enumerate(networks):
        open_ = (counts[:, _BALLOT.network] < 0) & (sizes > 0)
        if not open_.any():
            break
        whole = np.asarray(carried[:, [column(key) for key in network.keys]].all(axis=1))
        # One network a slot, by the majority of its samples: a slot of two networks would count twice.
        its_own = open_ & (2 * _sums(whole, edges) >= sizes)
        if not its_own.any():
            continue
        counts[its_own, _BALLOT.network] = k
        asked = whole & np.repeat(its_own, sizes)
        votes = np.full(len(moving), -1, dtype=np.int8)
        votes[asked] = network.votes(moving[asked])
        forward = np.where(np.isnan(moving[:, _V7]), moving[:, _V10], moving[:, _V7]) > 0
        tallies = [(votes >= least) & way for least in (0, 1) for way in (~forward, forward)]
        counts[its_own, 2:] = _sums(np.stack(tallies, axis=1), edges)[its_own]
    return counts


def outcome(networks: Sequence[Classifier], counts: Counts) -> VoteOutcome | None:
    """Return the outcome of one window, of shape (slots, 6), as :func:`outcomes` does."""
    return outcomes(networks, counts[None])[0]


def window_outcomes(networks: Sequence[Classifier], counts: Counts, slots: Array) -> list[VoteOutcome | None]:
    """Return what the networks say of each window; None where none is asked.

    The first network that can be asked answers: a network of windows where the log has the quantities of
    its statistics, another where its samples voted. A network of windows is not asked where a window shows
    nothing. Where the signs of most currents of a slot are unknown nobody votes: the others are no fair
    sample of the motion.

    Parameters
    ----------
    networks, counts
        As for :func:`outcomes`.
    slots
        The sums of the windows' slots (:func:`mavhums.health.estimation.motion.window_sums`), shape
        (windows, slots, sums).
    """
    sums = of_window(slots)
    asked, features = shows_something(sums), window_features(sums)
    signed = np.isfinite(features[:, WINDOW_KEYS.index("V5 rms")])
    answers = [vote if one else None for vote, one in zip(outcomes(networks, counts), signed, strict=True)]
    open_ = np.ones(len(sums), dtype=np.bool_)
    for number, network in enumerate(networks):
        voted = np.array([vote is not None and vote.network == number for vote in answers], dtype=np.bool_)
        if network.window_classes:
            probabilities, inside = network.classify_windows(features)
            known = open_ & np.isfinite(probabilities).all(axis=1)
            for k in np.flatnonzero(known).tolist():
                answers[k] = _of_window(network, number, probabilities[k], inside[k]) if asked[k] else None
            open_ &= ~known
        open_ &= ~voted
    return answers


def _of_window(network: Classifier, number: int, probabilities: Array, inside: bool) -> VoteOutcome:
    """Return what a network of windows says of one, from the probability of each class."""
    classes, most = network.window_classes, int(probabilities.argmax())
    # Between two faults a window is surely no less than the milder of them.
    reached = [float(probabilities[_grave(classes) >= least].sum()) for least in range(3)]
    surely = [least for least in (2, 1) if reached[least] >= network.window_level]
    healthy = 0 if 1.0 - reached[1] >= network.window_level else -1
    severity = -1 if not inside else surely[0] if surely else healthy
    decides = probabilities[most] >= network.window_level
    said = OUTSIDE if not inside else classes[most] if decides else ABSTAINED
    leaning = max(least for least in range(3) if reached[least] >= 0.5)
    return VoteOutcome(number, said, classes[most], severity, leaning, float(probabilities[most]), reached[1])


@cache
def _grave(classes: tuple[str, ...]) -> Integers:
    """Return the severity of each class."""
    emergencies = (FRICTION_EMERGENCY, "jam")
    return np.array([0 if one == "normal" else 2 if one in emergencies else 1 for one in classes])


def outcomes(networks: Sequence[Classifier], counts: Counts) -> list[VoteOutcome | None]:
    """Return the probability of an emergency in each window by votes; None if the networks abstain.

    They abstain with fewer than ten votes in either direction, and if more than half of the moving samples
    lie outside their training range. If the slots used several networks, the one with the most votes
    decides; ties go to the first.

    Parameters
    ----------
    networks
        As for :func:`count_votes`.
    counts
        Rows of the windows' slots, shape (windows, slots, 6).
    """
    if not networks:
        return [None] * len(counts)
    chosen = counts[:, :, _BALLOT.network]
    tallies = np.stack([(counts * (chosen == k)[:, :, None]).sum(axis=1) for k in range(len(networks))])
    decides = tallies[:, :, _BALLOT.voters].sum(axis=2).argmax(axis=0)
    own = tallies[decides, np.arange(len(counts))]
    voters, emergency = own[:, _BALLOT.voters], own[:, _BALLOT.emergency]
    cast = voters.sum(axis=1)
    votes = (
        # An unknown load helps in one direction as much as it hinders in the other.
        (2 * voters.min(axis=1) >= LEAST_SAMPLES)
        # Most of the motion must lie within the training range.
        & (2 * cast >= counts[:, :, _BALLOT.moving].sum(axis=1))
    )
    # Each direction counts the same: an unknown load helps in one as much as it hinders in the other.
    share = np.mean(emergency / np.maximum(voters, 1), axis=1)
    return [
        by_votes(networks[network].probability(one), network) if voted else None
        for voted, network, one in zip(votes.tolist(), decides.tolist(), share.tolist(), strict=True)
    ]


def network_inputs(values: Array, angles: Flags) -> Array:
    """Return V1…V12 (n, 12) as networks are asked about them: without the angles that no sensor measured.

    An angle that is the integral of a speed drifts, and one that is divided from the other shows nothing of
    the gear.

    Parameters
    ----------
    values
        Shape (n, 12).
    angles
        Whether a sensor measured V2, and V3, shape (n, 2).
    """
    inputs = values.copy()
    inputs[:, ANGLES] = np.where(angles, values[:, ANGLES], np.nan)
    return inputs


def _sums(flags: Flags, edges: Integers) -> Counts:
    """Return the number of flags set between consecutive edges; (n, …) to (len(edges) − 1, …)."""
    running = np.zeros((len(flags) + 1, *flags.shape[1:]), dtype=np.int64)
    np.cumsum(flags, axis=0, out=running[1:])
    return running[edges[1:]] - running[edges[:-1]]


class SampleAnswers(NamedTuple):
    """What the networks say of n samples.

    Attributes
    ----------
    p_emergency
        Probability of an emergency, shape (n,); NaN where no network's quantities are all there.
    said
        Index into ``classes`` of the most probable class, shape (n,); -1 where there is no probability.
    inside
        Whether the sample lies within the training range of its network, shape (n,). Elsewhere the network
        abstains, whatever its class.
    classes
        Names of the classes of all these networks.
    """

    p_emergency: Array
    said: NDArray[np.int8]
    inside: Flags
    classes: tuple[str, ...]


def answer_samples(models: Sequence[Model], values: Array, measured: Flags) -> SampleAnswers:
    """Return the networks' answers on samples.

    Parameters
    ----------
    models
        Networks; the one with the most inputs comes first.
    values
        V1…V12, shape (n, 12).
    measured
        Which of them sensors measured, shape (n, 12).
    """
    count = len(values)
    classes = tuple(dict.fromkeys(name for model in models for name in model.classes))
    p_emergency, inside = np.full(count, np.nan), np.zeros(count, dtype=np.bool_)
    said = np.full(count, -1, dtype=np.int8)
    inputs = network_inputs(values, measured[:, ANGLES])
    carried = np.isfinite(inputs)
    open_ = np.ones(count, dtype=np.bool_)
    for model in models:
        # The first network whose quantities a sample carries answers it, and no other.
        own = open_ & np.asarray(carried[:, [column(key) for key in model.keys]].all(axis=1))
        open_ &= ~own
        if not own.any():
            continue
        answers = model.classify(inputs[own])
        names = np.array([classes.index(name) for name in model.classes], dtype=np.int8)
        # Quantities so large that the network's sums overflow have no probability.
        known = np.asarray(np.isfinite(answers.probabilities).all(axis=1))
        most = names[np.where(known[:, None], answers.probabilities, 0.0).argmax(axis=1)]
        p_emergency[own] = answers.probabilities[:, model.emergency]
        said[own] = np.where(known, most, -1)
        inside[own] = answers.inside & known
    return SampleAnswers(p_emergency, said, inside, classes)
