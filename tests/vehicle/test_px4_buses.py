"""PX4's outputs are those of their drivers, whatever the numbers of their instances and their units."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from mavhums.log import Table
from mavhums.vehicle.formats.px4_buses import PX4Buses
from tests.vehicle.tables import table_of

SURFACES = {"PWM_AUX_FUNC1": 201.0, "PWM_AUX_FUNC3": 202.0}
MOTORS = {f"PWM_MAIN_FUNC{n}": 100.0 + n for n in range(1, 5)}
DSHOT = {"PWM_MAIN_TIM0": -3.0}
CAN = {f"UAVCAN_EC_FUNC{n}": 100.0 + n for n in range(1, 5)}
SENT = {  # the outputs of each driver before and after arming, and the pulses that they mean
    "main": ([1000.0] * 4, [1200.0, 1300.0, 1400.0, 1500.0], [1200.0, 1300.0, 1400.0, 1500.0]),
    "dshot": ([0.0] * 4, [110.0, 600.0, 1000.0, 1999.0], [1055.0, 1300.2, 1500.3, 2000.0]),
    "can": ([0.0] * 4, [1.0, 2000.0, 4095.5, 8191.0], [1000.1, 1244.2, 1500.0, 2000.0]),
    "aux": ([1500.0, 0.0, 1500.0], [1400.0, 0.0, 1600.0], [1400.0, 0.0, 1600.0]),
    "none": ([0.0], [0.0], [0.0]),
}


def parameters(values: dict[str, float]) -> Table:
    rows = np.array([(k.encode(), v) for k, v in values.items()], dtype=[("name", "S20"), ("value", "<f8")])
    return table_of("parameter", rows, frame=np.arange(-len(rows), 0))


def outputs(instances: dict[int, str], rows: int = 20) -> Table:
    """Ten rows of each instance before it is armed, ten after, in turns."""
    sent = np.zeros(rows * len(instances), dtype=[("output", "<f4", (16,))])
    component = np.tile(sorted(instances), rows)
    for k, one in enumerate(component.tolist()):
        values = SENT[instances[one]][int(k // len(instances) >= rows // 2)]
        sent["output"][k, : len(values)] = values
    return table_of("actuator_outputs", sent, component=component)


@pytest.mark.parametrize(
    ("values", "drivers", "places"),
    [
        (MOTORS | SURFACES, ("main", "aux", "none"), (0, 1)),
        (MOTORS | SURFACES | DSHOT, ("dshot", "aux", "none"), (0, 1)),
        (CAN | SURFACES, ("can", "aux", "none"), (0, 1)),
        ({"UAVCAN_ENABLE": 3.0}, ("can", "aux", "none"), (0, 1)),  # before there were functions
        (SURFACES, ("aux", "none"), (1,)),
    ],
)
def test_any_order_of_the_instances_gives_the_same_outputs(
    values: dict[str, float], drivers: tuple[str, ...], places: tuple[int, ...]
) -> None:
    for order in permutations(range(len(drivers))):
        instances = dict(zip(order, drivers, strict=True))
        whole = outputs(instances)
        for size in (1, 7, len(whole)):
            buses = PX4Buses()
            buses.feed({"parameter": parameters(values)})
            parts = np.split(np.arange(len(whole)), range(size, len(whole), size))
            fed = (buses.feed({"actuator_outputs": whole.select(part)}) for part in parts)
            found = Table.concatenate([each["actuator_outputs"] for each in fed])
            armed = found.frame >= len(whole) // 2
            for driver, place in zip(drivers, places, strict=False):
                expected = SENT[driver][2]
                mine = found["output"][armed & (found.component == place)][:, : len(expected)]
                mine = mine[mine.any(axis=1)]  # one that is silent keeps its place until another has it
                assert len(mine) == 10, (order, driver)
                assert mine == pytest.approx(np.tile(expected, (10, 1)), abs=0.1)
            empty = whole.component == order[drivers.index("none")]
            assert not set(found.component[empty & armed][1:].tolist()) & set(places)


def test_outputs_of_a_damaged_definition_stay_as_they_are() -> None:
    whole = outputs({0: "main", 1: "aux"})
    numbers = np.zeros(len(whole), dtype=[("output", "<i4", (16,))])
    numbers["output"] = whole["output"]
    damaged = table_of("actuator_outputs", numbers, component=whole.component)
    buses = PX4Buses()
    buses.feed({"parameter": parameters(SURFACES)})
    found = buses.feed({"actuator_outputs": damaged})["actuator_outputs"]
    np.testing.assert_array_equal(found["output"], damaged["output"])


@pytest.mark.filterwarnings("error")
def test_a_signalling_nan_is_an_output_that_is_unknown() -> None:
    damaged = outputs({0: "main"})
    damaged["output"].view("<u4")[12, 3] = 0x7F800001
    found = PX4Buses().feed({"actuator_outputs": damaged})["actuator_outputs"]
    assert np.isnan(found["output"][12, 3])
    assert np.isnan(found["output"]).sum() == 1
