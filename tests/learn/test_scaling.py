import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from mavhums.learn.inference import unit_interval

finite = st.floats(allow_nan=False, allow_infinity=False)


@example(values=np.array([[-np.finfo(np.float64).max], [np.finfo(np.float64).max]]))
@given(values=hnp.arrays(np.float64, st.tuples(st.integers(1, 20), st.integers(1, 3)), elements=finite))
def test_the_range_becomes_the_unit_interval_and_the_order_stays(values: NDArray[np.float64]) -> None:
    minimum, maximum = values.min(axis=0), values.max(axis=0)
    scaled = unit_interval(values, minimum, maximum)
    assert ((scaled >= 0) & (scaled <= 1)).all()
    for feature, result in zip(values.T, scaled.T, strict=True):
        assert result[feature.argmin()] == 0
        assert (np.diff(result[feature.argsort()]) >= 0).all()
        if feature.max() / 2 > feature.min() / 2:
            assert result[feature.argmax()] == 1


def test_outside_falls_outside_and_a_constant_is_shifted() -> None:
    values = np.array([[-1.0, 5.0], [3.0, 7.0]])
    np.testing.assert_array_equal(
        unit_interval(values, np.array([0, 5]), np.array([2, 5])), [[-0.5, 0], [1.5, 2]]
    )
