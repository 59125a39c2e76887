"""The test of one multirotor's motors, row by row: effort beyond what the motion explains.

Effort is what the mixer was asked for: the thrusts times the motors' columns. A motor i that gives 1 − λ of
its thrust T_i leaves λ·T_i·c_i of it unanswered, so this part points along one known column. Three hypotheses
compete over windows of several lengths: nothing but noise, a payload or moving air, a motor that lost λ. All
is in units of the hover thrust of one motor.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.kernels import kernel
from mavhums.health.motor import thresholds as t
from mavhums.health.motor.hypotheses import (
    LOSSES,
    Rules,
    bound_losses,
    det,
    is_payload,
    of_motor,
    of_others,
    pair,
    quantiles,
)
from mavhums.vehicle.grid import RATE_HZ

COLUMNS: Final = 8
"""Of the result: motor from 1, or 0; window; log Bayes factor; share lost, its 95 % interval; another motor
with which it fits much better, from 1, or 0; whether it flew upright, for longer than its take-off."""

_RING: Final = 1024  # rows; more than the longest window with its reference
_COUNT, ALOFT, _WHOLE, _DIP, _GRACE, _DEAD, JUDGED, FLOWN, TIPPED, _EXPLAINED = range(10)
_QUICK: Final = 2  # windows that demand that the aircraft falls towards the motor
_SLOW_WINDOW: Final = 2  # the first that slow outputs show
_SLOW_ODDS: Final = 4  # the first that shows them with the usual odds
_FIRST_PAIRED: Final = 1  # windows that show two motors at once: such a flight is short
_LAST_PAIRED: Final = 3
_PAYLOAD: Final = 5  # window in which a payload or the air is recognised
_BOUND: Final = 3  # window that bounds what is lost
_LATER: Final = 5 * RATE_HZ  # rows in the air that must follow: at touch-down the effort winds up


class State(NamedTuple):
    """What is carried from row to row."""

    counts: Integers
    effort: Array
    thrust: Array
    rates: Array
    trim: Array
    hover: Array
    now: Array
    noise: Array
    weight: Array
    pending: Array
    held: Integers
    paired: Integers
    recent: Array
    bound: Integers
    turned: Array
    payload: Array


def rules_for(motors: int) -> Rules:
    """Return the rules for a number of motors."""
    more = motors > 4
    return Rules(
        t.WINDOWS,
        t.ODDS_MORE if more else t.ODDS_QUAD,
        t.SLOW_ODDS_MORE if more else t.SLOW_ODDS_QUAD,
        t.LEAST_LOSS_MORE if more else t.LEAST_LOSS_QUAD,
        np.rint(t.HELD_S * RATE_HZ).astype(np.int64),
        t.NOISE_SD,
        t.AIR,
        np.log(t.AIR_RARITY),
        t.AIR_SLOW,
        t.AIR_BESIDE,
        t.MODEL_ERROR,
        t.LEAST_GAIN,
        t.MOST_GAIN,
        rival_odds=t.RIVAL_ODDS,
        pair_odds=t.PAIR_ODDS,
        pair_beside_one=t.PAIR_BESIDE_ONE,
        payload_odds=t.PAYLOAD_ODDS,
        payload_beside_motor=t.PAYLOAD_BESIDE_MOTOR,
        noise_worth=t.NOISE_WORTH,
        noise_floor=t.NOISE_FLOOR,
        noise_most=t.NOISE_MOST,
        falls=t.FALLS,
        yaw_damping=t.YAW_DAMPING,
        yaw_damping_sd=t.YAW_DAMPING_SD,
        turn=t.TURN,
        quiet_turn=t.QUIET_TURN,
        least_thrust=t.LEAST_THRUST,
        least_upright=float(np.cos(np.radians(t.MOST_BANK_DEG))),
        reference=round(t.REFERENCE_S * RATE_HZ),
        gap=round(t.REFERENCE_GAP_S * RATE_HZ),
        airborne=round(t.AIRBORNE_S * RATE_HZ),
        settled=round(t.SETTLED_S * RATE_HZ),
        landed=round(t.LANDED_S * RATE_HZ),
        bank_grace=round(t.BANK_GRACE_S * RATE_HZ),
        upright=round(t.UPRIGHT_S * RATE_HZ),
    )


def new_state(motors: int) -> State:
    """Return the state before the first row."""
    windows = t.WINDOWS.size
    return State(
        np.zeros(_EXPLAINED + 1, dtype=np.int64),
        np.zeros((_RING, 3)),
        np.zeros((_RING, motors)),
        np.zeros((_RING, 3)),
        np.zeros((_RING, 3)),
        np.zeros(_RING),
        np.full(4 + motors, np.nan),
        np.zeros((windows, 3, 3)),
        np.zeros(windows),
        np.full((windows, 3), np.nan),
        np.zeros((windows, 2), dtype=np.int64),
        np.zeros(windows, dtype=np.int64),
        np.zeros((2, motors)),
        np.zeros((motors, 101), dtype=np.int64),
        np.zeros(_RING),
        np.zeros(2),
    )


@kernel
def follow(
    thrust: Array,
    rates: Array,
    upright: Array,
    hover: Array,
    grounded: Flags,
    slow: Flags,
    columns: Array,
    rules: Rules,
    s: State,
    found: Array,
) -> None:
    """Take rows, shape (n, …); write what they show to ``found``, shape (n, COLUMNS), 0 where nothing.

    ``upright`` is the cosine of the bank, ``hover`` the mean thrust of a hover, ``grounded`` tells where
    it is not in free flight, ``slow`` where the outputs come more rarely than :data:`SLOW_HZ`.
    """
    motors = columns.shape[0]
    for row in range(thrust.shape[0]):
        good = np.isfinite(upright[row])
        for i in range(motors):
            good = good and np.isfinite(thrust[row, i]) and np.isfinite(s.now[4 + i])
        for a in range(3):
            good = good and np.isfinite(rates[row, a])
        if good:
            _take(rates[row], upright[row], hover[row], grounded[row], columns, rules, s)
            settled = s.counts[ALOFT] > rules.settled and s.counts[_DIP] == 0 and s.counts[_DEAD] == 0
            found[row, 7] = 1.0 if settled and upright[row] > 0.866 else 0.0
            if s.counts[ALOFT] > rules.airborne and s.counts[_DIP] == 0 and s.counts[_DEAD] == 0:
                _test(slow[row], columns, rules, s, found[row])
        else:
            s.counts[_WHOLE] = 0
        # A motor takes about 0.05 s: its thrust answers the output of the row before.
        for i in range(motors):
            s.now[4 + i] = thrust[row, i]


@kernel
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
        if a < 2:
            effort -= s.payload[a]
        s.effort[at, a] = s.effort[before, a] + effort
        s.rates[at, a] = rates[a]
    s.turned[at] = s.turned[before] + rates[2]
    s.now[3] = hover
    c[_WHOLE] += 1
    low = mean < rules.least_thrust * hover
    c[_DIP] = c[_DIP] + 1 if low else 0
    if grounded or (c[_DIP] > rules.landed and mean < 0.5 * hover) or (c[ALOFT] == 0 and low):
        c[ALOFT], c[_WHOLE] = 0, 0
        s.recent[:] = 0.0
        s.now[0:3] = np.nan
        s.payload[:] = 0.0
        return
    if c[_DIP] > rules.landed:
        c[_WHOLE] = 0
    c[ALOFT] += 1
    c[FLOWN] += 1
    if upright < rules.least_upright:
        c[TIPPED] += 1
        c[_GRACE] += 1
        if c[_GRACE] > rules.bank_grace:
            c[_DEAD] = rules.upright
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


@kernel
def _test(slow: bool, columns: Array, rules: Rules, s: State, found: Array) -> None:
    """Test all windows that end at this row."""
    c = s.counts
    motors = columns.shape[0]
    e, asked, swing = np.empty(3), np.empty(motors), np.empty(3)
    noise = np.empty((3, 3))
    judged = False
    for w in range(rules.windows.size):
        span = rules.windows[w]
        if (
            (w > 3 and c[_COUNT] % 4)
            or c[_WHOLE] <= span
            or c[ALOFT] <= span + rules.gap + rules.airborne / 2 + 1
        ):
            continue
        if (w >= _QUICK and c[ALOFT] <= rules.settled) or (slow and w < _SLOW_WINDOW):
            continue
        # A window that begins before what a payload explains holds both.
        if c[_COUNT] - c[_EXPLAINED] < span or not _residual(w, columns, rules, s, e, asked, swing):
            continue
        _noise_of(w, rules, s, noise)
        at, begin = c[_COUNT] % _RING, (c[_COUNT] - span) % _RING
        turn = (s.turned[at] - s.turned[begin]) / span
        noise[2, 2] += (rules.yaw_damping_sd * turn) ** 2
        need = rules.odds[w] + (rules.slow_odds if slow and w < _SLOW_ODDS else 0.0)
        suspected = _weigh(w, need, e, asked, swing, noise, columns, rules, s, found)
        if w == _BOUND:
            judged = True
            if abs(turn) < rules.quiet_turn and abs(swing[2]) < rules.quiet_turn:
                bound_losses(e, asked, noise, columns, rules, s.recent[0])
        if not suspected:
            _learn(w, e, rules, s)
    if not judged:
        return
    c[JUDGED] += 1
    if c[JUDGED] % _LATER == 0:
        for i in range(motors):
            if s.recent[1, i] > 0.0:
                s.bound[i, min(int(np.ceil(100.0 * s.recent[1, i])), 100)] += 1
        s.recent[1] = s.recent[0]
        s.recent[0] = 0.0


@kernel
def _residual(w: int, columns: Array, rules: Rules, s: State, e: Array, asked: Array, swing: Array) -> bool:
    """Compute the effort of a window that neither trim nor motion explains; False where the trim is new."""
    span = rules.windows[w]
    count = s.counts[_COUNT]
    at, begin = count % _RING, (count - span) % _RING
    trim = (count - span - rules.gap) % _RING
    hover = s.hover[trim]
    if not hover > 0.0:
        return False
    for i in range(asked.size):
        asked[i] = (s.thrust[at, i] - s.thrust[begin, i]) / span / hover
    for a in range(3):
        beyond = ((s.effort[at, a] - s.effort[begin, a]) / span - s.trim[trim, a]) / hover
        if a == 2:
            beyond -= rules.yaw_damping * (s.turned[at] - s.turned[begin]) / span
        if not np.isfinite(beyond):
            return False
        swing[a] = s.rates[at, a] - s.rates[begin, a]
        speed = swing[a] * 20.0 / span / hover
        low, high = speed / rules.high_gain[a], speed / rules.low_gain[a]
        low, high = min(low, high), max(low, high)
        e[a] = beyond - high if beyond > high else beyond - low if beyond < low else 0.0
    return True


@kernel
def _noise_of(w: int, rules: Rules, s: State, noise: Array) -> None:
    """Compute the covariance of a window's effort: the flight's own, shrunk to the usual one."""
    worth = rules.noise_worth + s.weight[w]
    for a in range(3):
        for b in range(3):
            noise[a, b] = s.noise[w, a, b] / worth
        usual = rules.noise[w, a] ** 2
        noise[a, a] = max(noise[a, a] + rules.noise_worth * usual / worth, rules.noise_floor * usual)


@kernel
def _learn(w: int, e: Array, rules: Rules, s: State) -> None:
    """Add a window to the flight's own noise: one of those that do not overlap, and not the last one."""
    if s.counts[_COUNT] % max(_ROWS[w], 10) // (4 if w > 3 else 1):
        return
    if np.isfinite(s.pending[w, 0]):
        keep = 1.0 - 1.0 / rules.noise_most
        s.weight[w] = s.weight[w] * keep + 1.0
        for a in range(3):
            for b in range(3):
                s.noise[w, a, b] = s.noise[w, a, b] * keep + s.pending[w, a] * s.pending[w, b]
    s.pending[w] = e


_ROWS: Final = tuple(int(rows) for rows in t.WINDOWS)


@kernel
def _weigh(
    w: int,
    need: float,
    e: Array,
    asked: Array,
    swing: Array,
    noise: Array,
    columns: Array,
    rules: Rules,
    s: State,
    found: Array,
) -> bool:
    """Weigh the hypotheses on one window; return whether some motor is suspected."""
    motors = columns.shape[0]
    other = of_others(w, e, noise, rules)
    # No hypothesis can beat the other causes by more than this: mostly nothing need be weighed.
    most = -0.5 * np.log(det(noise)) - other
    if w == _PAYLOAD and is_payload(other, e, asked, noise, columns, rules):
        # Else it stays beside the trim for its memory, and a later turn adds the yaw of a motor.
        hover = s.hover[(s.counts[_COUNT] - rules.windows[w] - rules.gap) % _RING]
        s.payload[:] += e[:2] * hover
        s.counts[_EXPLAINED] = s.counts[_COUNT]
        return False
    if most < min(0.5 * need, rules.pair_odds):
        s.held[w, 0], s.paired[w] = 0, 0
        return False
    best, second, which = -1e300, -1e300, -1
    shares = np.empty(LOSSES)
    posterior = np.empty(LOSSES)
    for i in range(motors):
        total = of_motor(i, e, asked, noise, columns, rules, shares)
        if total > best:
            second, best, which = best, total, i
            posterior[:] = shares
        elif total > second:
            second = total
    odds = best - other
    low, mean, high = quantiles(posterior)
    suspected = odds > 0.5 * need and best - second > 0.5 * rules.rival_odds
    falls = True
    if w < _QUICK:
        size = np.hypot(columns[which, 0], columns[which, 1])
        towards = -(swing[0] * columns[which, 0] + swing[1] * columns[which, 1]) / size
        falls = towards >= rules.falls
    if _FIRST_PAIRED <= w <= _LAST_PAIRED:
        one, two = (0, 0)
        if most > rules.pair_odds and most > best - other + rules.pair_beside_one:
            one, two = pair(best, other, e, asked, noise, columns, rules)
        s.paired[w] = s.paired[w] + 1 if one else 0
        if s.paired[w] >= rules.held[w]:
            found[0], found[1], found[2], found[6] = one, float(w), odds, two
            found[3], found[4], found[5] = mean, low, high
        if one:
            return True
    sure = odds > need and best - second > rules.rival_odds and low > rules.least[w] and falls
    if not sure:
        s.held[w, 0] = 0
        return suspected
    if s.held[w, 1] != which:
        s.held[w, 0] = 0
    s.held[w, 1] = which
    s.held[w, 0] += 4 if w > 3 else 1
    if s.held[w, 0] < rules.held[w] or odds <= found[2] or found[6] > 0.0:
        return True
    found[0], found[1], found[2] = which + 1.0, float(w), odds
    found[3], found[4], found[5] = mean, low, high
    return True
