"""The test of one multirotor's motors, row by row: effort beyond what the motion explains.

Effort is what the mixer was asked for: the thrusts times the motors' columns. A motor i that gives 1 − λ of
its thrust T_i leaves λ·T_i·c_i of it unanswered, so this part points along one known column. The test sums,
row by row, the likelihood of each fault against that of health: noise, a payload or moving air. All is in
units of the hover thrust of one motor.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Array1, Array2, Flags1, Integers1, Integers2
from mavhums.core.kernels import kernel, subroutine
from mavhums.core.statistics import NORMAL_95
from mavhums.health.decision.thresholds import MOST_BANK_DEG, NAMED
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.health.motor import thresholds as t
from mavhums.health.motor.hypotheses import (
    Hypotheses,
    hypotheses_of,
    inverse,
    of_health,
    of_losses,
    regression,
)
from mavhums.health.sequential import accumulate, threshold
from mavhums.vehicle.grid import RATE_HZ

COLUMNS: Final = 7
"""Of the result: motor from 1, or 0; rows since it lost thrust; evidence; share lost, its 95 % interval;
whether it flew upright, for longer than its take-off. Each motor's part of the evidence where it has more."""

_RING: Final = 64  # rows; more than the longest window with its reference
_COUNT, ALOFT, _WHOLE, _DIP, _GRACE, _DEAD, JUDGED, FLOWN, TIPPED, _BLOCK = range(10)
_FASTEST: Final = 100.0  # rad/s; no gyro measures more, and the noise of a turn stays invertible
_LEAST_ASKED: Final = 0.3  # thrust by hover thrust of which a share shows
_LATER: Final = 5 * RATE_HZ  # rows in the air that must follow: at touch-down the effort winds up


class Rules(NamedTuple):
    """What decides, for the kernels; :mod:`mavhums.health.motor.thresholds` describes it.

    Times are numbers of rows.
    """

    threshold: float
    named: float
    noise: Array1
    noise_worth: float
    noise_most: float
    air: Array1
    air_change: float
    model_error: float
    low_gain: Array1
    high_gain: Array1
    yaw_damping: float
    yaw_damping_sd: float
    turn: float
    least_thrust: float
    least_upright: float
    span: int
    block: int
    bound: int
    reference: int
    airborne: int
    settled: int
    bank_grace: int


class State(NamedTuple):
    """What is carried from row to row."""

    counts: Integers1
    effort: Array2
    thrust: Array2
    rates: Array2
    trim: Array2
    hover: Array1
    now: Array1
    noise: Array2
    weight: Array1
    block: Array2
    air: Array1
    values: Array2
    sums: Array2
    since: Integers2
    recent: Array2
    bound: Integers2
    turned: Array1


def rules_for(false_alarms: float) -> Rules:
    """Return the rules for an accepted number of false alarms in 100 hours."""
    return Rules(
        threshold=threshold(false_alarms / RATE_HZ),
        named=NAMED,
        noise=t.NOISE_SD**2,
        # Fewer blocks than axes have no covariance; later wind replaces the calm before.
        noise_worth=float(t.NOISE_SD.size),
        noise_most=WINDOW_S / t.CORRELATED_S,
        air=t.AIR[0] ** 2,
        air_change=1.0 / (t.AIR_CHANGES_S * RATE_HZ),
        model_error=t.MODEL_ERROR,
        low_gain=t.LEAST_GAIN,
        high_gain=t.MOST_GAIN,
        yaw_damping=t.YAW_DAMPING,
        yaw_damping_sd=t.YAW_DAMPING / 2.0,
        turn=t.TURN,
        least_thrust=t.LEAST_THRUST,
        least_upright=float(np.cos(np.radians(MOST_BANK_DEG))),
        span=t.SPAN_ROWS,
        block=round(t.CORRELATED_S * RATE_HZ),
        bound=round(t.BOUND_S * RATE_HZ),
        reference=round(t.REFERENCE_S * RATE_HZ),
        airborne=round(t.AIRBORNE_S * RATE_HZ),
        settled=round(t.SETTLED_S * RATE_HZ),
        bank_grace=round(t.BANK_GRACE_S * RATE_HZ),
    )


def new_state(motors: int) -> State:
    """Return the state before the first row."""
    hypotheses = hypotheses_of(motors)
    faults = motors, hypotheses.losses.size
    return State(
        counts=np.zeros(_BLOCK + 1, dtype=np.int64),
        effort=np.zeros((_RING, 3)),
        thrust=np.zeros((_RING, motors)),
        rates=np.zeros((_RING, 3)),
        trim=np.zeros((_RING, 3)),
        hover=np.zeros(_RING),
        now=np.full(4 + motors, np.nan),
        noise=np.zeros((3, 3)),
        weight=np.zeros(1),
        block=np.vstack([np.zeros(3), np.full(3, np.nan)]),
        air=hypotheses.air_weights.copy(),
        values=np.full(faults, -np.inf),
        sums=np.zeros(faults),
        since=np.zeros(faults, dtype=np.int64),
        recent=np.zeros((2, motors)),
        bound=np.zeros((motors, 101), dtype=np.int64),
        turned=np.zeros(_RING),
    )


@kernel
def follow(
    thrust: Array2,
    rates: Array2,
    upright: Array1,
    hover: Array1,
    grounded: Flags1,
    spacing: Array1,
    columns: Array2,
    rules: Rules,
    hypotheses: Hypotheses,
    s: State,
    found: Array2,
) -> None:
    """Take rows, shape (n, …); write what they show to ``found``, shape (n, COLUMNS …), 0 where nothing.

    ``upright`` is the cosine of the bank, ``hover`` the mean thrust of a hover, ``grounded`` is true where
    it is not in free flight, ``spacing`` how many rows an output lasts.
    """
    motors = columns.shape[0]
    for row in range(thrust.shape[0]):
        good = np.isfinite(upright[row]) and np.isfinite(spacing[row])
        for i in range(motors):
            good = good and np.isfinite(thrust[row, i]) and np.isfinite(s.now[4 + i])
        for a in range(3):
            good = good and abs(rates[row, a]) < _FASTEST  # false of NaN
        if good:
            _take(rates[row], upright[row], hover[row], grounded[row], columns, rules, s)
            calm = s.counts[_DIP] == 0 and s.counts[_DEAD] == 0
            settled = calm and s.counts[ALOFT] > rules.settled
            found[row, 6] = 1.0 if settled and upright[row] > 0.866 else 0.0
            if calm and s.counts[ALOFT] > rules.airborne:
                _test(spacing[row], columns, rules, hypotheses, s, found[row])
            elif s.counts[ALOFT] == 0:
                s.values[:], s.sums[:], s.air[:] = -np.inf, 0.0, hypotheses.air_weights
        else:
            s.counts[_WHOLE] = 0
        # A motor takes about 0.05 s: its thrust answers the output of the row before.
        for i in range(motors):
            s.now[4 + i] = thrust[row, i]


@subroutine
def _take(
    rates: Array, upright: float, hover: float, grounded: bool, columns: Array, rules: Rules, s: State
) -> None:
    """Take one row into the sums and the trim, and decide whether it may be judged."""
    motors = columns.shape[0]
    c = s.counts
    c[_COUNT] += 1
    at, before = c[_COUNT] % _RING, (c[_COUNT] - 1) % _RING
    mean = 0.0
    for i in range(motors):
        s.thrust[at, i] = s.thrust[before, i] + s.now[4 + i]
        mean += s.now[4 + i] / motors
    for a in range(3):
        effort = 0.0
        for i in range(motors):
            effort += s.now[4 + i] * columns[i, a]
        s.effort[at, a] = s.effort[before, a] + effort
        s.rates[at, a] = rates[a]
    s.turned[at] = s.turned[before] + rates[2]
    s.now[3] = hover
    c[_WHOLE] += 1
    low = mean < rules.least_thrust * hover
    c[_DIP] = c[_DIP] + 1 if low else 0
    if grounded or (c[_DIP] > rules.bound and mean < 0.5 * hover) or (c[ALOFT] == 0 and low):
        c[ALOFT], c[_WHOLE] = 0, 0
        s.recent[:] = 0.0
        s.now[0:3] = np.nan
        return
    # Far above a hover's thrust a motor may be at the end of its range: the trim does not hold there.
    if c[_DIP] > rules.bound or mean > hover / rules.least_thrust:
        c[_WHOLE] = 0
    c[ALOFT] += 1
    c[FLOWN] += 1
    if upright < rules.least_upright:
        c[TIPPED] += 1
        c[_GRACE] += 1
        if c[_GRACE] > rules.bank_grace:
            c[_DEAD] = rules.airborne
    elif upright > 0.866:
        c[_GRACE] = 0
        if c[_DEAD] > 0:
            c[_DEAD] -= 1
            c[_WHOLE] = 0
    # The effort of a climb with much more thrust than a hover's is no trim.
    if (
        c[ALOFT] > rules.airborne / 2
        and rules.least_thrust * hover < mean < hover / rules.least_thrust
        and c[_GRACE] == 0
    ):
        share = max(1.0 / (c[ALOFT] - rules.airborne / 2), 1.0 / rules.reference)
        for a in range(3):
            effort = s.effort[at, a] - s.effort[before, a]
            # The effort of a turn is no trim.
            part = share / (1.0 + (rates[2] / rules.turn) ** 2) if a == 2 else share
            s.now[a] = effort if not np.isfinite(s.now[a]) else s.now[a] + part * (effort - s.now[a])
    for a in range(3):
        s.trim[at, a] = s.now[a]
    s.hover[at] = s.now[3]


@subroutine
def _test(spacing: float, columns: Array, rules: Rules, h: Hypotheses, s: State, found: Array) -> None:
    """Test the row."""
    c = s.counts
    e, asked, swing = np.empty(3), np.empty(columns.shape[0]), np.empty(3)
    if c[_WHOLE] <= rules.span or not _residual(rules.span, rules, s, e, asked, swing):
        return
    # The rows of one output, and those that gusts correlate, say as much as one row does.
    correlated = max(float(rules.block), spacing)
    precision = inverse(_noise(rules.span, correlated, rules, s))
    ratios = np.empty_like(s.values)
    of_losses(e, asked, precision, columns, h, ratios)
    ratios -= of_health(e, precision, rules.air_change, h, s.air)
    accumulate(c[_COUNT], ratios, s.values, s.sums, s.since)
    if _conclude(correlated, columns, rules, s, found) < rules.threshold / 3.0:
        _learn(e, rules, s)
    if c[ALOFT] > rules.settled and c[_WHOLE] > rules.bound:
        _bound(correlated, columns, rules, s)


@subroutine
def _conclude(correlated: float, columns: Array, rules: Rules, s: State, found: Array) -> float:
    """Return the evidence; write which motor lost how much, where it is enough and the motor is certain."""
    most = s.values.max()
    shares = np.exp(s.values - most)
    evidence = float(most + np.log(shares.mean()))
    for i in range(found.size - COLUMNS):
        found[COLUMNS + i] = max(most + np.log(shares[i].sum() / shares.size), 0.0)
    if evidence < rules.threshold:
        return evidence
    motor = np.argmax(shares.sum(axis=1))
    if shares[motor].sum() < rules.named * shares.sum():
        return evidence
    rows = s.counts[_COUNT] - s.since[motor, np.argmax(shares[motor])] + rules.span
    e, asked, swing = np.empty(3), np.empty(columns.shape[0]), np.empty(3)
    span = min(rows, rules.bound, s.counts[_WHOLE] - 1)
    if _residual(span, rules, s, e, asked, swing) and asked[motor] >= _LEAST_ASKED:
        noise = _noise(span, correlated / span, rules, s)
        loss, deviation = regression(e, asked[motor], noise, columns[motor])
        half = NORMAL_95 * np.hypot(deviation, rules.model_error * loss)
        found[0], found[1], found[2], found[3] = motor + 1.0, rows, evidence, min(max(loss, 0.0), 1.0)
        found[4], found[5] = max(found[3] - half, 0.0), min(found[3] + half, 1.0)
    return evidence


@subroutine
def _bound(correlated: float, columns: Array, rules: Rules, s: State) -> None:
    """Bound what the motors may have lost, over a longer window."""
    c = s.counts
    e, asked, swing = np.empty(3), np.empty(columns.shape[0]), np.empty(3)
    if not _residual(rules.bound, rules, s, e, asked, swing):
        return
    if abs(_mean_turn(rules.bound, s)) < rules.turn and abs(swing[2]) < rules.turn:
        noise = _noise(rules.bound, correlated / rules.bound, rules, s)
        for a in range(3):
            noise[a, a] += rules.air[a]
        for i in range(asked.size):
            if asked[i] >= _LEAST_ASKED:
                loss, deviation = regression(e, asked[i], noise, columns[i])
                s.recent[0, i] = max(s.recent[0, i], loss + NORMAL_95 * deviation)
    c[JUDGED] += 1
    if c[JUDGED] % _LATER == 0:
        for i in range(asked.size):
            if s.recent[1, i] > 0.0:
                s.bound[i, min(int(np.ceil(100.0 * s.recent[1, i])), 100)] += 1
        s.recent[1] = s.recent[0]
        s.recent[0] = 0.0


@subroutine
def _mean_turn(span: int, s: State) -> float:
    """Return the mean yaw rate over the last rows, rad/s."""
    count = s.counts[_COUNT]
    return float((s.turned[count % _RING] - s.turned[(count - span) % _RING]) / span)


@subroutine
def _residual(span: int, rules: Rules, s: State, e: Array, asked: Array, swing: Array) -> bool:
    """Compute the effort of a window that neither trim nor motion explains; False where the trim is new."""
    count = s.counts[_COUNT]
    at, begin = count % _RING, (count - span) % _RING
    hover = s.hover[begin]
    if not hover > 0.0:
        return False
    for i in range(asked.size):
        asked[i] = (s.thrust[at, i] - s.thrust[begin, i]) / span / hover
    for a in range(3):
        beyond = ((s.effort[at, a] - s.effort[begin, a]) / span - s.trim[begin, a]) / hover
        if a == 2:
            beyond -= rules.yaw_damping * _mean_turn(span, s)
        if not np.isfinite(beyond):
            return False
        swing[a] = s.rates[at, a] - s.rates[begin, a]
        speed = swing[a] * RATE_HZ / span / hover
        low, high = speed / rules.high_gain[a], speed / rules.low_gain[a]
        low, high = min(low, high), max(low, high)
        e[a] = beyond - high if beyond > high else beyond - low if beyond < low else 0.0
    return True


@subroutine
def _noise(span: int, share: float, rules: Rules, s: State) -> Array:
    """Return a share of the covariance of a block's effort, and that of the yaw damping, shape (3, 3).

    The covariance is the flight's own, shrunk to the usual one.
    """
    worth = rules.noise_worth + s.weight[0]
    noise: Array = s.noise / worth
    for a in range(3):
        noise[a, a] += rules.noise_worth * rules.noise[a] / worth
    noise *= share
    noise[2, 2] += max(share, 1.0) * (rules.yaw_damping_sd * _mean_turn(span, s)) ** 2
    return noise


@subroutine
def _learn(e: Array, rules: Rules, s: State) -> None:
    """Add a row to the flight's own noise, block by block, and not the last block."""
    s.block[0] += e / rules.block
    s.counts[_BLOCK] += 1
    if s.counts[_BLOCK] % rules.block:
        return
    if np.isfinite(s.block[1, 0]):
        keep = 1.0 - 1.0 / rules.noise_most
        s.weight[0] = s.weight[0] * keep + 1.0
        s.noise[:] = s.noise * keep + np.outer(s.block[1], s.block[1])
    s.block[1], s.block[0] = s.block[0], 0.0
