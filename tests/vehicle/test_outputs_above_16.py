"""Outputs 17 to 32 come in a second or third message of every format, and move surfaces as the others do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.log import Table
from mavhums.vehicle.facts import Signal
from mavhums.vehicle.flight import Flight
from mavhums.vehicle.grid import RATE_HZ, Grid
from mavhums.vehicle.parameters import Parameters, control_surfaces
from mavhums.vehicle.rows import Rows
from mavhums.vehicle.signals import SignalReader
from mavhums.vehicle.surfaces import of_parameters
from tests.present import present
from tests.vehicle.tables import table_of

SECONDS, RATE = 8, 25
N = SECONDS * RATE
PULSES = np.rint(1500 + 300 * np.sin(np.arange(N) / 20)).astype(np.uint16)


def table(name: str, columns: dict[str, Any], component: int = 1) -> Table:
    """Return a table of N messages in which each of a pair of messages comes every second time."""
    wire = np.dtype(
        [(key, np.asarray(values).dtype, np.shape(values)[1:]) for key, values in columns.items()]
    )
    fields = np.zeros(N, dtype=wire)
    for key, values in columns.items():
        fields[key] = values
    times = np.arange(N) * 1_000_000 // RATE
    return table_of(name, fields, frame=np.arange(N) * 2, time_us=times, component=component)


def both(one: Table, other: Table) -> Table:
    """Return two tables of one message as they come in turn."""
    order = np.argsort(np.concatenate([one.frame, other.frame + 1]), kind="stable")
    return Table.concatenate([one, other]).select(order)


def mavlink() -> dict[str, Table]:
    banks = []
    for port, pulses in enumerate((np.full(N, 1100, dtype=np.uint16), PULSES)):
        columns = {f"servo{n}_raw": pulses if n == 4 else np.zeros(N, dtype=np.uint16) for n in range(1, 17)}
        times = (np.arange(N) * 1_000_000 // RATE).astype(np.uint32)
        banks.append(
            table("SERVO_OUTPUT_RAW", columns | {"port": np.full(N, port, np.uint8), "time_usec": times})
        )
    return {"SERVO_OUTPUT_RAW": both(*banks)}


def ulog() -> dict[str, Table]:
    outputs = np.zeros((N, 16), dtype=np.float32)
    first, second = outputs.copy(), outputs.copy()
    first[:, 3], second[:, 3] = 1100, PULSES
    return {
        "actuator_outputs": both(
            table("actuator_outputs", {"output": first}, 0), table("actuator_outputs", {"output": second}, 1)
        )
    }


def dataflash() -> dict[str, Table]:
    first = table("RCOU", {f"C{n}": np.full(N, 1100, np.uint16) for n in range(1, 15)})
    third = table("RCO3", {f"C{n}": PULSES if n == 20 else np.zeros(N, np.uint16) for n in range(19, 33)})
    return {"RCOU": first, "RCO3": third}


def demand(signals: list[Signal], servo: int) -> NDArray[np.float64]:
    values = {f"SERVO{servo}_FUNCTION": 19.0, f"SERVO{servo}_MIN": 1000.0, f"SERVO{servo}_MAX": 2000.0}
    parameters = Parameters(1, False, values | {f"SERVO{servo}_TRIM": 1500.0})
    assert [output.servo for output in control_surfaces(parameters)] == [servo]
    surfaces = present(of_parameters(parameters))
    seconds = present(Grid(0).feed(signals, final=True))
    flight = Flight(surfaces)
    rows: list[Rows] = list(flight.feed(seconds))
    assert "outputs" in flight.heard
    return np.concatenate([each.demand("pitch") for each in rows])


@pytest.mark.parametrize("tables", [mavlink(), ulog(), dataflash()], ids=["mavlink", "ulog", "dataflash"])
def test_a_surface_on_output_20_is_followed(tables: dict[str, Table]) -> None:
    found = demand([*SignalReader().read(tables)], 20)
    assert np.isfinite(found).sum() >= (SECONDS - 1) * RATE_HZ
    assert np.nanmax(found) == pytest.approx(0.6, abs=0.02)
    assert np.nanmin(found) == pytest.approx(-0.6, abs=0.02)
    assert np.nanmax(np.abs(demand([*SignalReader().read(tables)], 4) + 0.8)) < 1e-6


def test_outputs_of_the_second_message_alone_suffice() -> None:
    tables = ulog()["actuator_outputs"]
    alone = {"actuator_outputs": tables.select(tables.component == 1)}
    assert np.isfinite(demand([*SignalReader().read(alone)], 20)).any()
