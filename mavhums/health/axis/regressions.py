"""Converts flight rows to a regression's columns, with the same lag, delay and 0.4 s mean on both sides.

Its filters keep their state, so that the rows may be divided into any blocks.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import exp
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Array1, Flags
from mavhums.core.kernels import kernel
from mavhums.health.axis.thresholds import LEAST_SPEED_SHARE, MEAN_ROWS, SLOW_STREAM_S
from mavhums.health.decision.thresholds import MOST_BANK_DEG
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.rows import Rows
from mavhums.vehicle.surfaces import STEERING

_MOST_RAD: Final = np.radians(MOST_BANK_DEG)
STEP_S: Final = 1.0 / RATE_HZ


def hold_last(values: Array, before: float) -> Array:
    """Replace values that are not finite by the previous value; ``before`` precedes the first."""
    known = np.isfinite(values)
    if known.all():
        return np.ascontiguousarray(values)
    rows = np.where(known, np.arange(values.size), -1)
    last = np.maximum.accumulate(rows)
    return np.where(last < 0, before, values[np.maximum(last, 0)])


@kernel
def _smoothed(values: Array1, share: float, before: float) -> Array:
    """Return ``y[k] = y[k-1] + share · (values[k] - y[k-1])``, whose ``y[-1]`` is ``before``."""
    out = np.empty_like(values)
    for k in range(values.size):
        before += share * (values[k] - before)
        out[k] = before
    return out


class Lag:
    """A first-order lag with the time constant ``tau_s``; at zero the output is the input."""

    def __init__(self, tau_s: float) -> None:
        self._share = 1.0 - exp(-STEP_S / tau_s) if tau_s > 0 else 1.0
        self._last: float | None = None
        self._value = 0.0

    def feed(self, values: Array) -> Array:
        """Return the lagged values, shape (n,); missing values are replaced by the last one."""
        if self._last is None:
            finite = values[np.isfinite(values)]
            self._last = self._value = float(finite[0]) if finite.size else 0.0
        filled = hold_last(values, self._last)
        self._last = float(filled[-1])
        out = _smoothed(filled, self._share, self._value)
        self._value = float(out[-1])
        return out


@kernel
def _levels(values: Array1, units: Array1, share: float, state: Array1) -> Array:
    """Return the exponentially weighted mean of values by that of units; the state is updated."""
    out = np.zeros_like(values)
    for k in range(values.size):
        state *= 1.0 - share
        if np.isfinite(values[k]):
            state[0] += share * values[k]
            state[1] += share * units[k]
        if state[1] > 0.0:
            out[k] = state[0] / state[1]
    return out


class HighPass:
    """A high-pass filter: subtracts the mean over the last ``memory_s``, or that share of a unit.

    Values that are not known age the mean: after a gap the next ones begin a new one.
    """

    def __init__(self, memory_s: float) -> None:
        self._share = 1.0 - exp(-STEP_S / memory_s)
        self._state = np.zeros(2)

    def feed(self, values: Array, unit: Array | None = None) -> Array:
        """Return values (n,) without their slow part, which is in proportion to a positive unit (n,)."""
        values = np.ascontiguousarray(values)
        units = np.ones_like(values) if unit is None else np.ascontiguousarray(unit)
        return np.asarray(values - units * _levels(values, units, self._share, self._state))


class Tail:
    """Buffers the last rows of columns, for delays and moving means.

    Parameters
    ----------
    columns
        Number m of columns.
    rows
        Number of past rows that are needed.
    """

    def __init__(self, columns: int, rows: int) -> None:
        self._kept = np.full((rows, columns), np.nan)

    def feed(self, values: Array) -> Array:
        """Return the buffered rows followed by these, shape (rows + n, m)."""
        joined = np.concatenate([self._kept, values])
        self._kept = joined[len(joined) - len(self._kept) :]
        return joined


class Shape(NamedTuple):
    """The response of an axis: pure delay in rows, and the time constant of a first-order lag, s."""

    delay_rows: int
    tau_s: float


class Form:
    """A regression: the drive by the demand, the nuisances, and the aircraft's response."""

    axis: str
    nuisances: int
    beside: tuple[str, ...] = ()
    """Axes whose demands are among the nuisances."""
    derivative = False
    """Whether the response is the rate of change of ``answer``."""
    least_speed_share = LEAST_SPEED_SHARE
    """Share of the reference's speed below which it is not judged."""
    trimmed = False
    """Whether v² shows the trim: only of a settled speed, and as far above the reference's as below."""
    speed_errors = 2.0
    """Relative errors of the speed in one of the gain."""
    turns_steadily = False
    """Whether full deflection lasts. The drive then varies with the speed's error, which moves nothing."""

    def drive(self, demand: Array, relative: Array) -> Array:
        """Return the moment of the lagged demand at a speed relative to the reference, (n,): v²·δ."""
        return relative**2 * demand

    def others(self, rows: Rows, relative: Array, demands: dict[str, Array]) -> Array:
        """Return the other contributions to the response, shape (n, nuisances)."""
        raise NotImplementedError

    def answer(self, rows: Rows) -> Array:
        """Return the aircraft's response, shape (n,)."""
        raise NotImplementedError

    def unexplained(self, answered: float, driven: float) -> float:
        """Return the part of a mean response, without the nuisances', that the gain's does not explain."""
        return answered - driven

    def spacing(self, rows: Rows) -> Array:
        """Return the longest spacing of the demand's and the response's samples, s, shape (n,)."""
        return rows.spacing

    def possible(self, others: Array) -> bool:
        """Return whether an aircraft can have these coefficients of the others."""
        return True

    def kept(self, beta: Array, speed: float) -> dict[str, float]:
        """Return what the coefficients show of the aircraft beside the gain, by the fault that changes it."""
        return {}


class Columns(NamedTuple):
    """The regression's columns: drive (n,), nuisances (n, m), response (n,), and the mask of usable rows.

    ``unit`` (n,) is what their slow parts are in proportion to; None if they are constant.
    """

    drive: Array
    others: Array
    answer: Array
    good: Flags
    unit: Array | None = None


class Basis(NamedTuple):
    """What a reference rests on beside the outputs: the speed that is its unit, m/s, and its sources."""

    speed: float
    sources: float

    @classmethod
    def of(cls, rows: Rows) -> Basis:
        """Return the median speed in forward flight, and the usual sources."""
        if not rows.flying.any():
            return cls(0.0, 0.0)
        sources, counts = np.unique(rows.sources[rows.flying], return_counts=True)
        usual = float(sources[np.argmax(counts)])
        return cls(float(np.median(rows.speed[rows.flying & (rows.sources == usual)])), usual)


def judgeable(rows: Rows, basis: Basis, form: Form, least_share: float = LEAST_SPEED_SHARE) -> Flags:
    """Return the mask of forward flight at a known, sufficient speed, neither inverted nor diving.

    ``least_share`` is the sufficient share of the reference's speed. Rates and speeds from other sources than
    the reference's are no measure of what is left of it.
    """
    # Near the stall ailerons lose most of their effect without a fault.
    slow = rows.speed < min(least_share, form.least_speed_share) * basis.speed
    # The regressions are linear in the angles, and an attitude that is not known may be any.
    level = (np.abs(rows.roll) <= _MOST_RAD) & (np.abs(rows.pitch) <= _MOST_RAD)
    gap = form.spacing(rows) > 2.0 * SLOW_STREAM_S  # one lost sample passes
    good: Flags = rows.flying & rows.trusted & ~gap & ~slow & level & np.isfinite(rows.speed)
    good &= rows.sources == basis.sources
    return good


class Chain:
    """Computes the columns of a form incrementally.

    Parameters
    ----------
    form
        The regression.
    basis
        Speed that is the unit of relative speeds, and the sources that count.
    shape
        Delay and lag of the answer.
    extra_tau_s
        An additional lag of the demand, as of a slow servo.
    least_share
        Share of the reference's speed from which rows are usable.
    """

    def __init__(
        self,
        form: Form,
        basis: Basis,
        shape: Shape,
        extra_tau_s: float = 0.0,
        least_share: float = LEAST_SPEED_SHARE,
    ) -> None:
        self._form, self._basis, self._shape = form, basis, shape
        self._extra, self._least_share = extra_tau_s, least_share
        self._reset()

    def _reset(self) -> None:
        form, shape = self._form, self._shape
        self._lags = {axis: Lag(shape.tau_s) for axis in (form.axis, *form.beside)}
        self._slower = Lag(self._extra)
        self._demands = Tail(len(self._lags), shape.delay_rows + 1)
        self._means = Tail(2 + form.nuisances, MEAN_ROWS + 1)

    def feed(self, rows: Rows) -> Columns:
        """Return the columns of these rows; a gap resets the filters."""
        if rows.fresh:
            self._reset()
        n, form = len(rows), self._form
        relative = rows.speed / self._basis.speed
        lagged = np.stack([lag.feed(rows.demand(axis)) for axis, lag in self._lags.items()], axis=1)
        # Only the axis's own servo is suspected to be slow.
        if self._extra:
            lagged[:, 0] = self._slower.feed(lagged[:, 0])
        late = self._demands.feed(lagged)[1 : n + 1]
        demands = dict(zip(self._lags, late.T, strict=True))
        drive = form.drive(demands[form.axis], relative)
        raw = np.column_stack([drive, form.others(rows, relative, demands), form.answer(rows)])
        # The filters fill gaps of the demand; a filled demand is no evidence.
        known = np.where(np.isfinite(rows.demand(form.axis)), 1.0, np.nan)
        joined = self._means.feed(raw * known[:, None])
        total = joined[1 : n + 2].copy()
        for k in range(1, MEAN_ROWS):
            total += joined[1 + k : n + 2 + k]
        means = total / MEAN_ROWS
        now, before = means[1:], means[:-1]
        answer = now[:, -1]
        if form.derivative:
            # The difference of two means is half a row later than either: so are the other columns taken.
            answer = (now[:, -1] - before[:, -1]) * RATE_HZ
            now = (now + before) / 2
        usable = judgeable(rows, self._basis, form, self._least_share)
        if form.trimmed:
            usable &= rows.settled & (relative * self._least_share <= 1.0)
        good = usable & np.isfinite(now[:, :-1]).all(axis=1) & np.isfinite(answer)
        unit = now[:, 1] if form.turns_steadily else None
        return Columns(now[:, 0], now[:, 1:-1], answer, good, unit)


class RollForm(Form):
    """``p = K·v·δ + b·v + c·r``: roll rate p, relative airspeed v, demand δ by the ailerons, yaw rate r."""

    axis = "roll"
    nuisances = 2
    speed_errors = 0.0  # the deviation of a second's gain covers one; counted, it hides two real ailerons

    def drive(self, demand: Array, relative: Array) -> Array:
        """Return v·δ."""
        return relative * demand

    def others(self, rows: Rows, relative: Array, demands: dict[str, Array]) -> Array:
        """Return v for the trim, and the yaw rate: in a turn the outer wing is faster and lifts more."""
        return np.column_stack([relative, rows.yaw_rate])

    def answer(self, rows: Rows) -> Array:
        """Return the roll rate."""
        return rows.roll_rate

    def kept(self, beta: Array, speed: float) -> dict[str, float]:
        """Return the demand that keeps the wings level, −b/K."""
        return {"hard_over": -beta[1] / beta[0]}


class SteeringForm(RollForm):
    """``r = K·v·δ + b·v``: yaw rate r, speed v, demand δ of the steering of a rover or a boat."""

    axis = STEERING
    nuisances = 1
    least_speed_share = 0.0  # wheels steer at any speed
    speed_errors = 1.0
    turns_steadily = True

    def others(self, rows: Rows, relative: Array, demands: dict[str, Array]) -> Array:
        """Return v for the trim."""
        return relative[:, None]

    def answer(self, rows: Rows) -> Array:
        """Return the yaw rate."""
        return rows.yaw_rate

    def unexplained(self, answered: float, driven: float) -> float:
        """Return what no share of the gain explains: turns last, so that a loss shifts their mean."""
        return answered - min(max(answered, min(driven, 0.0)), max(driven, 0.0))


class PitchForm(Form):
    """``q̇ = K·v²·δ + a·v² + b·v·q + c·n``: pitch rate q, load factor n for the angle of attack."""

    axis = "pitch"
    nuisances = 3
    derivative = True
    trimmed = True

    def others(self, rows: Rows, relative: Array, demands: dict[str, Array]) -> Array:
        """Return v² for the trim, v·q for the damping, n for the stability."""
        return np.column_stack([relative**2, relative * rows.pitch_rate, rows.load])

    def answer(self, rows: Rows) -> Array:
        """Return the pitch rate; its rate of change is the response."""
        return rows.pitch_rate

    def possible(self, others: Array) -> bool:
        """Return whether pitching is damped: else the autopilot's feedback was found, not the aircraft."""
        return bool(others[1] < 0.0)

    def kept(self, beta: Array, speed: float) -> dict[str, float]:
        """Return the steady load factor by the full demand, over the square of the speed, |K/c|/V²."""
        return {"manoeuvre": abs(beta[0] / beta[3]) / speed**2}


class YawForm(Form):
    """``a = K·v²·δ + …``: side force a, without the parts of aileron, trim, yaw rate, roll rate and bank."""

    axis = "yaw"
    nuisances = 5
    beside = ("roll",)

    def others(self, rows: Rows, relative: Array, demands: dict[str, Array]) -> Array:
        """Return v²·δ of the ailerons, v², v·r, v·p and sin φ."""
        square = relative**2
        aileron = np.nan_to_num(demands["roll"])
        rates = (relative * rows.yaw_rate, relative * rows.roll_rate)
        return np.column_stack([square * aileron, square, *rates, np.sin(rows.roll)])

    def answer(self, rows: Rows) -> Array:
        """Return the side force."""
        return rows.side_force

    def spacing(self, rows: Rows) -> Array:
        """Return the longest spacing, that of the force included."""
        return np.fmax(rows.spacing, rows.force_spacing)


FORMS: Final[Mapping[str, Form]] = {
    "roll": RollForm(),
    "pitch": PitchForm(),
    "yaw": YawForm(),
    STEERING: SteeringForm(),
}
"""The regression of each axis."""
