"""What ArduPilot's on-board log tells of an actuator, from records to quantities."""

from __future__ import annotations

from math import nan, pi

import numpy as np
import pytest

from mavhums.actuator.draft import announcements
from mavhums.actuator.mapping import Mapper
from mavhums.actuator.profile import Airframe, load_airframe
from mavhums.actuator.telemetry import best_tier, tiers_by_content
from mavhums.core.quantities import column
from mavhums.log import Decoder, Table
from mavhums.vehicle.states import FlightMode, VehicleStates, texts
from tests.log.dataflash.synthetic import definition, fmt_of_fmt, record

PAPER = load_airframe("paper")
NEW = ("QBfffBfffffB", "TimeUS,Id,Pos,Force,Speed,Pow,PosCmd,V,A,MotT,PCBT,Err")
OLD = ("QBfffB", "TimeUS,Id,Pos,Force,Speed,Pow")
ESC = ("QBffff", "TimeUS,Instance,RPM,RawRPM,Volt,Curr")
RCOU = ("QHHHH", "TimeUS,C1,C2,C3,C4")
NVF = ("QNf", "TimeUS,Name,Value")
MSG = ("QZ", "TimeUS,Message")
MODE = ("QMBB", "TimeUS,Mode,ModeNum,Rsn")


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


def volz(number: int, position: float = 12.0) -> tuple[object, ...]:
    return (number, position, nan, nan, 255, 13.5, 14.8, 0.25, 30.0, 35.0, 0)


def test_a_servo_of_the_autopilots_own_is_counted_from_zero() -> None:
    values, provenance, tiers = mapped(logged("CSRV", NEW, volz(2)))
    assert set(values) == {"elevator"}
    [row] = values["elevator"]
    wanted = {"V1": 13.5, "V3": 12.0, "V4": 14.8, "V5": 0.25, "V6": 14.8 * 0.25}
    assert {key: row[column(key)] for key in wanted} == pytest.approx(wanted, rel=1e-6)
    assert np.isnan([row[column(key)] for key in ("V7", "V10", "V11", "V12")]).all()
    assert provenance["elevator"]["V3"] == "CSRV[2].Pos"
    assert tiers["elevator"] == "csrv"


def test_a_servo_on_dronecan_is_counted_from_one_and_tells_its_speed() -> None:
    row = (3, 12.0, 0.5, 60.0, 40, nan, nan, nan, nan, nan, 0)
    values, provenance, _ = mapped(logged("CSRV", NEW, row))
    assert set(values) == {"elevator"}
    [found] = values["elevator"]
    assert found[column("V10")] == pytest.approx(10.0)
    assert found[column("V7")] == pytest.approx(3000.0)
    assert np.isnan(found[column("V11")])  # a Force is a load only where a profile maps it
    assert provenance["elevator"]["V7"] == "derived: V10·N"


def test_before_4_7_the_buss_radians_were_handed_on() -> None:
    values, _, _ = mapped(logged("CSRV", OLD, (3, pi / 6, 0.5, pi, 40)))
    [row] = values["elevator"]
    assert row[column("V3")] == pytest.approx(30.0)
    assert row[column("V10")] == pytest.approx(30.0)


def test_a_profile_may_say_which_id_is_which() -> None:
    actuators = [a.model_copy(update={"csrv": 9 if a.name == "elevator" else None}) for a in PAPER.actuators]
    other = PAPER.model_copy(update={"actuators": tuple(actuators)})
    values, provenance, _ = mapped(logged("CSRV", NEW, volz(9), volz(2), volz(0)), other)
    assert set(values) == {"elevator", "aileron_left"}
    assert provenance["elevator"]["V3"] == "CSRV[9].Pos"


def test_an_escs_numbers_are_magnitudes() -> None:
    rows = [(2, -900.0, 0.0, 12.0, 0.5)] * 3
    tables = logged("ESC", ESC, *rows)
    _, provenance, tiers = mapped(tables)
    assert tiers == {"elevator": "esc-unsigned"}
    assert provenance["elevator"]["V5"].startswith("derived: magnitude from ESC[2].Curr")
    assert best_tier(tables) is not None


def test_a_logged_pulse_is_the_command() -> None:
    values, provenance, tiers = mapped(logged("RCOU", RCOU, (1500, 1500, 1750, 0)))
    assert values["elevator"][:, 0].tolist() == [30.0]
    assert "rudder" not in values
    assert provenance["elevator"] == {"V1": "RCOU.C3"}
    assert tiers["elevator"] == "pwm"


def test_named_floats_are_logged_too() -> None:
    tables = logged("NVF", NVF, (b"S3V05", 0.75), (b"BATT", 1.0))
    values, provenance, tiers = mapped(tables)
    assert values["elevator"][:, column("V5")].tolist() == [0.75]
    assert provenance["elevator"]["V5"] == "NVF[S3V05].Value"
    assert tiers["elevator"] == "named"
    assert tiers_by_content(tables) == {(1, "named")}


def test_texts_name_the_airframe() -> None:
    tables = logged("MSG", MSG, (b"ArduPlane V4.7.0",), (b"mavhums airframe=paper",))
    assert [said.text for said in texts(tables)] == ["ArduPlane V4.7.0", "mavhums airframe=paper"]
    [said] = announcements(tables)
    assert (said.vehicle, said.name, said.known) == (1, "paper", True)


def test_modes_wait_for_the_kind_of_vehicle() -> None:
    modes = VehicleStates()
    assert list(modes.feed(logged("MODE", MODE, (10, 10, 1), (10, 10, 1), (5, 5, 1)), start_us=0)) == []
    changes = modes.feed(logged("MSG", MSG, (b"ArduPlane V4.7.0-dev (2598e9d4)",)), start_us=0)
    assert [(one.vehicle, one.mode) for one in changes if isinstance(one, FlightMode)] == [
        (1, "AUTO"),
        (1, "FBWA"),
    ]
