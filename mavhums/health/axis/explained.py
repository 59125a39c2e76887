"""How much of an axis's response a demand explains: which outputs move it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mavhums.core.arrays import Array
from mavhums.health.axis.reference import least_squares, shapes
from mavhums.health.axis.regressions import FORMS, Basis, Chain, Lag, Shape
from mavhums.health.axis.thresholds import LEAST_ROWS_PER_S, MEAN_ROWS, REFERENCE_S
from mavhums.vehicle.rows import Rows
from mavhums.vehicle.surfaces import AXES


def explained_by(axis: str, rows: Rows, demand: Array, others: Array) -> tuple[float, float]:
    """Return how much of the response about an axis a demand explains, and how much of the rest others do.

    Unlike in a reference, all usable rows count.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    rows
        The flight.
    demand, others
        The demand in question, shape (n,), and others, shape (n, k).

    Returns
    -------
    tuple
        Of the response that is left without any demand, the share that the demand explains; of what it
        leaves, the share that the others explain. Zero if the rows do not suffice.
    """
    outputs = np.full((len(rows), len(AXES)), np.nan)
    outputs[:, AXES.index(axis)] = demand
    # Which output moves the axis does not need the speed that its gain does.
    form, rows = FORMS[axis], replace(rows, outputs=outputs, settled=np.full(len(rows), True))
    basis = Basis.of(rows)
    best = 0.0, 0.0
    for shape in shapes(axis):
        columns = Chain(form, basis, shape).feed(rows)
        late = _late(others, shape) * (rows.speed / basis.speed)[:, None]
        good = columns.good & np.isfinite(late).all(axis=1)
        if good.sum() < REFERENCE_S * LEAST_ROWS_PER_S:
            continue
        nuisances, answer = columns.others[good], columns.answer[good]
        own = np.column_stack([columns.drive[good], nuisances])
        beta, left = least_squares(own, answer)
        _, without = least_squares(nuisances, answer)
        if not left < without * (1.0 - best[0]) or not form.possible(beta[1:]):
            continue
        both = least_squares(np.column_stack([own, late[good]]), answer)[1] if others.size else left
        best = 1.0 - left / without, 1.0 - both / left
    return best


def _late(demands: Array, shape: Shape) -> Array:
    """Return demands with the delay and the lag of a response, and half of the mean of its columns."""
    late = shape.delay_rows + MEAN_ROWS // 2
    out = np.full_like(demands, np.nan)
    for k, demand in enumerate(demands.T):
        out[late:, k] = Lag(shape.tau_s).feed(demand)[: len(demand) - late]
    return out
