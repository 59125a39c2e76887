"""What flights show of an individual and its wear, against regressions on the same numbers."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.core.arrays import Array
from mavhums.health.estimation.equations.own_scale import CURRENT, POWER, ROUGHNESS
from mavhums.health.estimation.flight_sums import KEPT, POWER_COLUMNS, QUADRATIC
from mavhums.health.estimation.least_squares import packed
from mavhums.health.estimation.thresholds import LOAD_SHOWS_ERRORS
from mavhums.health.estimation.wear import (
    Law,
    Nuisances,
    _law,
    information,
    learned,
    load_direction,
    mean_load,
    shows,
    wear,
)
from mavhums.results.verdict import OwnRecord


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


def strokes(*rows: tuple[float, float], equation: str = ROUGHNESS.name) -> OwnRecord:
    """Return a record of strokes: quantity and load of each."""
    groups = tuple((1.0, *row) for row in rows)
    return OwnRecord(equation=equation, setup="strokes", rate_hz=50.0, duration_s=60.0, groups=groups)


def parts(*grams: Array, counts: float = 100.0, airspeed: str = "airspeed") -> OwnRecord:
    """Return a record of the friction current whose parts have these sums."""
    groups = tuple((counts, *packed(gram)) for gram in grams)
    setup = f"angle from V3, {airspeed}"
    return OwnRecord(equation=CURRENT.name, setup=setup, rate_hz=50.0, duration_s=60.0, groups=groups)


def gram_of(samples: int, seed: int, friction: float, noise: float, drag: float = 0.3) -> Array:
    """Return the sums of samples whose left side is friction, drag and noise; no other term acts."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((samples, len(KEPT)))
    X[:, KEPT.index("sign")] = np.sign(X[:, KEPT.index("speed")])
    X[:, KEPT.index("loaded")] = 0.0
    X[:, -1] = friction * X[:, 0] + drag * X[:, 1] + noise * rng.standard_normal(samples)
    return X.T @ X


def test_the_wear_of_strokes_is_their_mean() -> None:
    """Its error is a thousandth, so that only the scatter between flights counts; four strokes are enough."""
    record = strokes((0.1, 1.0), (0.2, 2.0), (0.3, -1.0), (0.6, 2.0))
    found = wear(record, None)
    assert found is not None
    assert (found.value, found.error, found.freedom) == pytest.approx((0.3, 0.0003, 3.0))
    assert mean_load(record) == pytest.approx(1.0)
    assert mean_load(strokes((0.1, -3.0))) == pytest.approx(3.0)
    assert load_direction(record) == pytest.approx(0.5)
    assert information(record) == 4.0
    assert wear(strokes(*[(0.1, 1.0)] * 3), None) is None


def test_the_mean_load_is_that_in_motion_and_unknown_in_old_records() -> None:
    gram = np.zeros((len(KEPT), len(KEPT)))
    gram[0, 0], loaded = 10.0, KEPT.index("loaded")
    gram[0, loaded] = gram[loaded, 0] = 25.0
    assert mean_load(parts(gram, gram)) == pytest.approx(2.5)
    assert mean_load(parts(np.zeros_like(gram))) is None
    assert mean_load(parts(gram).model_copy(update={"equation": POWER.name})) is None


@pytest.mark.parametrize(
    ("grams", "information", "shown"),
    [([10.0] * 4, 40.0, True), ([9.9] * 4, 39.6, False), ([20.0] * 3, 60.0, False)],
)
def test_a_flight_needs_four_parts_and_forty_samples(
    grams: list[float], information: float, shown: bool
) -> None:
    record = parts(*(size * np.eye(len(KEPT)) for size in grams))
    assert shows(record) == shown
    assert sum(row[1] for row in record.groups) == pytest.approx(information)
    power = np.eye(POWER_COLUMNS)
    for count, enough in ((20.0, True), (19.9, False)):
        many = parts(*[power] * 4, counts=count).model_copy(update={"equation": POWER.name})
        assert shows(many) == enough


def test_a_flight_teaches_by_the_inverse_variance_of_its_residuals() -> None:
    """Two flights disagree about the drag; each counts by its degrees of freedom over its residual."""
    flights = [(1, 0.3, 0.1), (2, 0.5, 0.4)]
    grams = [
        [gram_of(50, 10 * seed + k, 0.2, noise, drag) for k in range(4)] for seed, drag, noise in flights
    ]
    found = learned([parts(*one, counts=50.0, airspeed="no airspeed") for one in grams])
    normal, right = np.zeros((2, 2)), np.zeros(2)
    for one in grams:
        # The sign is free in each flight, and the angle, which "no airspeed" leaves free as well.
        rest = np.linalg.inv(np.sum(one, axis=0)[np.ix_([0, 1, 2, 4, 6], [0, 1, 2, 4, 6])])
        covariance = np.linalg.inv(rest[np.ix_([1, 2, 4], [1, 2, 4])])
        held = covariance[:2, :2]
        residual = covariance[2, 2] - covariance[:2, 2] @ np.linalg.solve(held, covariance[:2, 2])
        weight = (200.0 - 4 - 2 - 1) / residual
        normal, right = normal + weight * held, right + weight * covariance[:2, 2]
    assert isinstance(found, Nuisances)
    assert [found.held[KEPT.index(name)] for name in ("speed", "acceleration")] == pytest.approx(
        np.linalg.solve(normal, right), rel=1e-6
    )
    assert found.free == (KEPT.index("angle"),)


def test_the_wear_with_known_nuisances_is_that_of_least_squares() -> None:
    """Without nuisances but a known drag: the friction, its jackknife over the parts, and its freedom."""
    grams = [gram_of(size, size, 0.2, 0.05) for size in (40, 50, 60, 70)]
    found = wear(parts(*grams), Nuisances({KEPT.index("speed"): 0.3}, ()))
    pull = np.array([gram[0, -1] - 0.3 * gram[0, 1] for gram in grams])
    size = np.array([gram[0, 0] for gram in grams])
    others = (pull.sum() - pull) / (size.sum() - size)
    assert found is not None
    assert found.value == pytest.approx(pull.sum() / size.sum())
    jackknife = np.sqrt(3 / 4 * np.sum((others - others.mean()) ** 2))
    squares = sum(gram[-1, -1] - 0.6 * gram[1, -1] + 0.09 * gram[1, 1] for gram in grams)
    independent = np.sqrt((squares - found.value**2 * size.sum()) / (400.0 - 4 - 1) / size.sum())
    assert found.error == pytest.approx(max(jackknife, independent), rel=1e-5)
    assert found.freedom == pytest.approx(size.sum() ** 2 / np.sum(size**2) - 1.0)
    loaded = wear(parts(*grams), Nuisances({KEPT.index("speed"): 0.3, KEPT.index("loaded"): 0.1}, (), 2.0))
    assert loaded is not None
    assert loaded.value == pytest.approx(found.value + 0.1 * 2.0)


def test_a_flight_without_motion_teaches_nothing_of_the_power() -> None:
    rng = np.random.default_rng(3)
    flown, still = [], [np.zeros((POWER_COLUMNS, POWER_COLUMNS))] * 4
    for _ in range(4):
        columns = rng.standard_normal((50, POWER_COLUMNS))
        columns[:, -1] += 3.0 * columns[:, list(QUADRATIC)].sum(axis=1)
        flown.append(columns.T @ columns)
    one, other = (parts(*grams).model_copy(update={"equation": POWER.name}) for grams in (flown, still))
    alone, beside = learned([one]), learned([one, other])
    assert isinstance(alone, Law)
    assert isinstance(beside, Law)
    assert beside.quadratic.tolist() == alone.quadratic.tolist()
    assert alone.quadratic == pytest.approx(3.0, abs=0.5)
    assert learned([other]) is None
