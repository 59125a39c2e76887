"""The law of an individual's power is that of a regression on its columns."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.health.estimation.flight_sums import POWER_COLUMNS, QUADRATIC
from mavhums.health.estimation.thresholds import LOAD_SHOWS_ERRORS
from mavhums.health.estimation.wear import _law


@pytest.mark.parametrize("alike", [0.0, 0.5, 0.95])
@pytest.mark.parametrize("unit", [1.0, 1e3])
@pytest.mark.parametrize(("errors", "shows"), [(1.03, True), (0.97, False), (-1.03, True), (-0.97, False)])
def test_a_law_needs_a_load_that_shows_beyond_its_error(
    alike: float, unit: float, errors: float, shows: bool
) -> None:
    """The sums have unit variance; the load's column resembles another one, in any unit."""
    rng = np.random.default_rng(2)
    columns = rng.standard_normal((60, POWER_COLUMNS))
    load, other = QUADRATIC.index(9), QUADRATIC.index(8)
    design = columns[:, list(QUADRATIC)]
    design[:, load] = unit * ((1 - alike) * design[:, load] + alike * design[:, other])
    true = np.linspace(0.5, 1.5, len(QUADRATIC))
    error = np.linalg.inv(design.T @ design)[load, load] ** 0.5
    true[load] = errors * LOAD_SHOWS_ERRORS * error
    columns[:, list(QUADRATIC)], columns[:, -1] = design, design @ true
    law = _law(columns.T @ columns, 0.3)
    assert (law is not None) == shows
    if law is not None:
        np.testing.assert_allclose(law.quadratic, true, rtol=1e-6)
        assert law.friction == 0.3
