"""What the tests of the learning room share."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.core.quantities import column
from mavhums.learn import Card, Network, Selection, wrapper

Flights = tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.int64]]


def flight(friction_nm: float, seed: int, samples: int = 240) -> NDArray[np.float64]:
    """V1–V12 of a servo that sweeps against friction: enough structure to select and to learn from."""
    random = np.random.default_rng(seed)
    time = np.arange(samples) * 0.05
    angle, speed = 20 * np.sin(time + seed), 20 * np.cos(time + seed)
    hinge = random.normal(size=samples)
    torque = (friction_nm * np.sign(speed) + 0.1 * hinge) / 600
    current, rotor = torque / 0.024, speed * 600
    voltage = 2.2 * current + 0.024 * np.deg2rad(rotor)
    columns = (angle, angle * 600, angle, voltage, current, voltage * current, rotor / 6, torque)
    return np.column_stack(
        (*columns, torque * np.deg2rad(rotor), speed / 6, hinge, hinge * np.deg2rad(speed))
    )


@pytest.fixture
def flights() -> Callable[..., Flights]:
    """Several flights one after another, an emergency from 0.5 N·m."""

    def build(*frictions_nm: float) -> Flights:
        parts = [flight(friction, seed) for seed, friction in enumerate(frictions_nm)]
        numbers = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        return np.vstack(parts), np.asarray(frictions_nm)[numbers] > 0.5, numbers

    return build


@pytest.fixture
def network() -> Network:
    random = np.random.default_rng(7)
    return Network(
        keys=("V2", "V5", "V11"),
        minimum=np.array([-100.0, -1.0, 0.0]),
        maximum=np.array([300.0, 1.0, 5.0]),
        w1=random.normal(size=(3, 4)),
        b1=random.normal(size=4),
        w2=random.normal(size=(4, 2)),
        b2=random.normal(size=2),
    )


@pytest.fixture
def values(network: Network) -> NDArray[np.float64]:
    """Fifty samples within the network's trained range; what it does not read is NaN."""
    samples = np.full((50, 12), np.nan)
    columns = [column(key) for key in network.keys]
    samples[:, columns] = np.random.default_rng(8).uniform(network.minimum, network.maximum, (50, 3))
    return samples


@pytest.fixture
def card() -> Card:
    return Card(
        name="test",
        airframe="paper",
        features=("V2", "V5", "V11"),
        tier="instrumented",
        conditions={"coulomb_friction_nm": [0.225, 1.025], "cyclogram": "take-off"},
        metrics={"test_accuracy": 0.98},
        selection=Selection(
            chi_square={"V2": 3.0, "V5": 2.5, "V11": 0.0},
            p_values={"V2": 0.1, "V5": 0.2, "V11": 1.0},
            groups=(("V2",), ("V5",), ("V11",)),
            selected=("V2", "V5", "V11"),
        ),
        seed=3,
        command="mavhums train --seed 3 -o test.safetensors",
        versions={"torch": "2.13.0"},
    )


@pytest.fixture
def small_wrapper(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wrapper of the same two rounds with fewer iterations and seeds."""
    for name, value in {"_ITERATIONS": 20, "_SHORTLIST": 3, "_COMPARED_ITERATIONS": 40, "_SEEDS": 1}.items():
        monkeypatch.setattr(wrapper, name, value)
