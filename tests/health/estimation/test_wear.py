"""What flights show of an individual and its wear, against regressions on the same numbers."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.core.arrays import Array
from mavhums.health.estimation.equations.own_scale import CURRENT, ROUGHNESS
from mavhums.health.estimation.flight_sums import KEPT
from mavhums.health.estimation.least_squares import packed
from mavhums.health.estimation.wear import (
    Nuisances,
    information,
    learned,
    load_direction,
    mean_load,
    shows,
    wear,
)
from mavhums.results.verdict import OwnRecord
from tests.present import present


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
    found = present(wear(record, None))
    assert (found.value, found.error, found.freedom) == pytest.approx((0.3, 0.0003, 3.0))
    assert mean_load(record) == pytest.approx(1.0)
    assert mean_load(strokes((0.1, -3.0))) == pytest.approx(3.0)
    assert load_direction(record) == pytest.approx(0.5)
    assert information(record) == 4.0
    assert wear(strokes(*[(0.1, 1.0)] * 3), None) is None


def test_the_mean_load_is_that_in_motion() -> None:
    gram = np.zeros((len(KEPT), len(KEPT)))
    gram[0, 0], loaded = 10.0, KEPT.index("loaded")
    gram[0, loaded] = gram[loaded, 0] = 25.0
    assert mean_load(parts(gram, gram)) == pytest.approx(2.5)
    assert mean_load(parts(np.zeros_like(gram))) is None


@pytest.mark.parametrize(
    ("grams", "information", "shown"),
    [([10.0] * 4, 40.0, True), ([9.9] * 4, 39.6, False), ([20.0] * 3, 60.0, False), ([8.0] * 5, 40.0, True)],
)
def test_a_flight_needs_4_parts_and_40_samples(grams: list[float], information: float, shown: bool) -> None:
    record = parts(*(size * np.eye(len(KEPT)) for size in grams))
    assert shows(record) == shown
    assert sum(row[1] for row in record.groups) == pytest.approx(information)


@pytest.mark.parametrize(("seed", "larger"), [(0, "jackknife"), (1, "independent")])
def test_the_wear_with_known_nuisances_is_that_of_least_squares(seed: int, larger: str) -> None:
    """Without nuisances but a known drag: the friction, the larger of its two errors, and its freedom."""
    grams = [gram_of(size, size + seed, 0.2, 0.05) for size in (40, 50, 60, 70)]
    found = present(wear(parts(*grams), Nuisances({KEPT.index("speed"): 0.3}, ())))
    pull = np.array([gram[0, -1] - 0.3 * gram[0, 1] for gram in grams])
    size = np.array([gram[0, 0] for gram in grams])
    others = (pull.sum() - pull) / (size.sum() - size)
    assert found.value == pytest.approx(pull.sum() / size.sum())
    errors = {"jackknife": np.sqrt(3 / 4 * np.sum((others - others.mean()) ** 2))}
    squares = sum(gram[-1, -1] - 0.6 * gram[1, -1] + 0.09 * gram[1, 1] for gram in grams)
    left = squares - found.value**2 * size.sum()
    errors["independent"] = np.sqrt(left / (400.0 - 4 - 1) / size.sum())
    assert max(errors, key=errors.__getitem__) == larger
    assert found.error == pytest.approx(errors[larger], rel=1e-5)
    assert found.freedom == pytest.approx(size.sum() ** 2 / np.sum(size**2) - 1.0)
    total, columns = np.sum(grams, axis=0), [0, 1, 2, 3]
    alone = present(wear(parts(*grams), None))
    # A flight by itself fits drag, inertia and load beside the friction.
    fitted = np.linalg.solve(total[np.ix_(columns, columns)], total[columns, -1])
    assert alone.value == pytest.approx(fitted[0])
    by_load = Nuisances({KEPT.index("speed"): 0.3, KEPT.index("loaded"): 0.1}, (), 2.0)
    loaded = present(wear(parts(*grams), by_load))
    assert loaded.value == pytest.approx(found.value + 0.1 * 2.0)


def loaded_parts(seed: int, load_friction: float) -> tuple[list[Array], Array]:
    """Return the sums of four parts with friction by load, and all their samples."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((400, len(KEPT)))
    X[:, 0] = np.sign(X[:, 1])
    loaded = KEPT.index("loaded")
    X[:, loaded] = X[:, 0] * (2.0 + np.abs(X[:, loaded]))
    X[:, -1] = 0.2 * X[:, 0] + 0.3 * X[:, 1] + load_friction * X[:, loaded] + 0.1 * rng.standard_normal(400)
    return [part.T @ part for part in np.split(X, 4)], X


@pytest.mark.parametrize(("errors", "shown"), [(1.03, True), (0.97, False), (-1.03, False), (-3.0, False)])
def test_a_friction_by_load_shows_from_some_errors_on(errors: float, shown: bool) -> None:
    """One that is negative is no friction, however surely it shows."""
    loaded, (_, samples) = KEPT.index("loaded"), loaded_parts(4, 0.0)
    design = samples[:, [0, 1, 2, 3, loaded]]
    coefficients, squares, _, _ = np.linalg.lstsq(design, samples[:, -1])
    variance = float(squares[0]) / (400 - 4 - 4 - 1)  # samples, parts, coefficients and the friction
    error = (variance * np.linalg.inv(design.T @ design)[-1, -1]) ** 0.5
    load_friction = errors * 5.0 * error
    grams, samples = loaded_parts(4, load_friction - coefficients[-1])
    record = parts(*grams)
    found = learned([record])
    assert isinstance(found, Nuisances)
    assert found.load_friction == pytest.approx(load_friction if shown else 0.0)
    assert found.load == pytest.approx(np.abs(samples[:, loaded]).mean() if shown else 0.0)


def test_a_flight_that_moves_in_one_part_only_has_no_error() -> None:
    still, moved = np.zeros((len(KEPT), len(KEPT))), gram_of(200, 1, 0.2, 0.05)
    assert shows(parts(still, still, still, moved))
    assert wear(parts(still, still, still, moved), Nuisances({}, ())) is None
    assert wear(parts(still, still, moved, moved), Nuisances({}, ())) is not None


def test_a_flight_whose_fit_leaves_no_freedom_teaches_nothing() -> None:
    grams, _ = loaded_parts(4, 0.0)
    own, few = parts(*grams), parts(*grams, counts=1.0)
    assert present(learned([own, few])) == learned([own])
