"""What ArduPilot's on-board log tells of an actuator, from records to quantities."""

from __future__ import annotations

from math import nan

import numpy as np
import pytest

from mavhums.actuator.mapping import Mapper
from mavhums.actuator.profile import Airframe, load_airframe
from mavhums.actuator.telemetry import tiers_by_content
from mavhums.core.quantities import column
from mavhums.log import Decoder, Table
from tests.log.dataflash.synthetic import definition, fmt_of_fmt, record

PAPER = load_airframe("paper")
NEW = ("QBfffBfffffB", "TimeUS,Id,Pos,Force,Speed,Pow,PosCmd,V,A,MotT,PCBT,Err")
NVF = ("QNf", "TimeUS,Name,Value")


def logged(name: str, layout: tuple[str, str], *rows: tuple[object, ...]) -> dict[str, Table]:
    data = fmt_of_fmt() + definition(5, name, *layout)
    data += b"".join(record(5, layout[0], [10_000 * k, *row]) for k, row in enumerate(rows, start=1))
    return Decoder().feed(data, final=True)


def mapped(
    tables: dict[str, Table], airframe: Airframe = PAPER
) -> tuple[dict[str, np.ndarray], dict[str, dict[str, str]], dict[str, str | None]]:
    mapper = Mapper(airframe)
    found: dict[str, list[np.ndarray]] = {}
    for part in mapper.feed(tables, final=True):
        found.setdefault(part.actuator.name, []).append(part.values)
    actuators = {actuator.name: actuator for actuator in airframe.actuators}
    return (
        {name: np.concatenate(parts) for name, parts in found.items()},
        {name: mapper.of(1, actuators[name]).provenance for name in found},
        {name: mapper.of(1, actuators[name]).tier for name in found},
    )


def test_a_servo_on_dronecan_is_counted_from_one_and_tells_its_speed() -> None:
    row = (3, 12.0, 0.5, 60.0, 40, nan, nan, nan, nan, nan, 0)
    values, provenance, _ = mapped(logged("CSRV", NEW, row))
    assert set(values) == {"elevator"}
    [found] = values["elevator"]
    assert found[column("V10")] == pytest.approx(10.0)
    assert found[column("V7")] == pytest.approx(3000.0)
    assert np.isnan(found[column("V11")])  # a Force is a load only where a profile maps it
    assert provenance["elevator"]["V7"] == "derived: V10·N"


def test_named_floats_are_logged_too() -> None:
    tables = logged("NVF", NVF, (b"S3V05", 0.75), (b"BATT", 1.0))
    values, provenance, tiers = mapped(tables)
    assert values["elevator"][:, column("V5")].tolist() == [0.75]
    assert provenance["elevator"]["V5"] == "NVF[S3V05].Value"
    assert tiers["elevator"] == "named"
    assert tiers_by_content(tables) == {(1, "named")}
