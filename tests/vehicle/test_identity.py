"""Who a vehicle is, as it says itself."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.log import Decoder
from mavhums.vehicle.identity import IDENTITY_MESSAGES, PERIPHERALS, Identities, _version, in_words
from tests.log.ulog import writer
from tests.logs import write_log
from tests.vehicle.tables import table_of, version


def identities(path: Path) -> Identities:
    decoder, found = Decoder(IDENTITY_MESSAGES), Identities()
    found.feed(decoder.feed(path.read_bytes()))
    found.feed(decoder.feed(b"", final=True))
    return found


def beat(kind: int, autopilot: int) -> Any:
    return v2.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3)


UNNAMED = {"GENERIC", "SPACECRAFT_ORBITER", "GROUND_QUADRUPED", "ENUM_END"}
SYNONYMS = {"GCS": "station", "ONBOARD_CONTROLLER": "companion", "ADSB": "ADS-B", "ODID": "ID"}
SYNONYMS |= {"LOG": "logger", "OSD": "on-screen"}
BEAT = np.dtype([(name, "u4") for name in ("type", "autopilot", "base_mode", "custom_mode")])


def heard(name: str, row: tuple[Any, ...], kinds: Any) -> Identities:
    """Return who vehicles are by one message."""
    found = Identities()
    found.feed({name: table_of(name, np.array([row], dtype=kinds))})
    return found


def test_kinds_are_those_of_mavlink() -> None:
    """A word of ours is part of the name in MAVLink; a multirotor is what has rotors and no wing."""
    for kind, entry in v2.enums["MAV_TYPE"].items():
        name = entry.name.removeprefix("MAV_TYPE_")
        article, _, words = in_words(kind).partition(" ")
        assert (words == f"vehicle of MAV_TYPE {kind}") == (name in UNNAMED), name
        alike = any(word.upper() in name for word in words.split())
        assert name in UNNAMED or alike or SYNONYMS.get(name, "-") in words, name
        assert (article == "an") == (words[0] in "aeioAEIO"), words
        found = heard("HEARTBEAT", (kind, 3, 0, 0), BEAT)
        assert found.vehicles == (() if kind in PERIPHERALS else (1,))
        rotors = "VTOL" not in name and ("ROTOR" in name or "TRICOPTER" in name)
        assert found.of(1).multirotor == rotors, name


def test_autopilots_are_those_of_mavlink() -> None:
    named = {"ArduPilot": "ARDUPILOTMEGA", "Paparazzi": "PPZ", "SMACCMPilot": "SMACCMPILOT"}
    named |= {"PX4": "PX4", "OpenPilot": "OPENPILOT"}
    for autopilot, entry in v2.enums["MAV_AUTOPILOT"].items():
        found = heard("HEARTBEAT", (1, autopilot, 0, 0), BEAT)
        name = entry.name.removeprefix("MAV_AUTOPILOT_")
        known = found.of(1).autopilot
        assert (known is None) == (name not in named.values()), name
        assert known is None or named[known] == name


@pytest.mark.parametrize(("kind", "autopilot"), [(6, 8), (6, 0), (26, 8), (18, 3), (27, 0), (2, 8)])
def test_a_ground_station_or_a_peripheral_is_no_vehicle(tmp_path: Path, kind: int, autopilot: int) -> None:
    assert identities(write_log(tmp_path / "one.tlog", [beat(kind, autopilot)])).vehicles == ()


def test_firmware_and_board_are_named(tmp_path: Path) -> None:
    said = [beat(2, 3), version(0x040507FF, uid=0xABC, uid2=b"\x01\x02")]
    who = identities(write_log(tmp_path / "one.tlog", said)).of(1)
    assert (who.kind, who.multirotor) == ("quadrotor", True)
    assert str(who) == "quadrotor, ArduPilot 4.5.7"
    assert who.board == "0102" + "00" * 10
    who = identities(write_log(tmp_path / "two.tlog", [version(0x01020380, uid=0xABC)])).of(1)
    assert (who.board, who.firmware) == ("0000000000000ABC", "1.2.3-beta")


def test_the_id_in_a_text_has_more_digits_and_is_the_board_whenever_it_comes(tmp_path: Path) -> None:
    """The simulator's text has all of the id of its machine, and its report the first 18 characters."""
    text = b"e2b5edb604543deab373d50adc66fa2e"
    said = [version(0, uid2=text[:18]), v2.MAVLink_statustext_message(6, text)]
    for k, several in enumerate((said, said[::-1], said[:1])):
        board = identities(write_log(tmp_path / f"{k}.tlog", several)).of(1).board
        assert board == ("SITL 65 2B5EDB604543DEAB373D50ADC66FA2E" if k < 2 else text[:18].hex().upper())


def test_releases_are_those_of_mavlink() -> None:
    for number, entry in v2.enums["FIRMWARE_VERSION_TYPE"].items():
        name = entry.name.removeprefix("FIRMWARE_VERSION_TYPE_").lower()
        if number < 256:
            assert _version(0x01020300 + number) == ("1.2.3" if name == "official" else f"1.2.3-{name}")


def test_a_text_names_the_firmware_better_than_a_number(tmp_path: Path) -> None:
    said = [v2.MAVLink_statustext_message(6, b"ArduPlane V4.5.7 (0fe2a2b6)"), version(0x040507FF)]
    assert identities(write_log(tmp_path / "one.tlog", said)).of(1).firmware == "ArduPlane V4.5.7"


@pytest.mark.parametrize(
    ("text", "kind", "multirotor"),
    [
        (b"ArduPlane V4.5.7", "fixed wing", False),
        (b"ArduCopter V4.3.0 (abc)", "multirotor", True),
        (b"APM:Copter V3.2", "multirotor", True),
        (b"ArduRover V4.2.0", "ground rover", False),
        (b"Rover V4.2", "ground rover", False),
        (b"Blimp V4.5.0", "airship", False),
        (b"ArduSub V4.1.0", "submarine", False),
        (b"PreArm: ArduCopter V4", None, False),
    ],
)
def test_a_text_names_the_kind_until_the_vehicle_says_its_own(
    tmp_path: Path, text: bytes, kind: str | None, multirotor: bool
) -> None:
    said = v2.MAVLink_statustext_message(6, text)
    who = identities(write_log(tmp_path / "one.tlog", [said])).of(1)
    assert (who.kind, who.multirotor) == (kind, multirotor)
    assert who.autopilot == (None if kind is None else "ArduPilot")
    for k, several in enumerate(([beat(13, 12), said], [said, beat(13, 12)])):
        who = identities(write_log(tmp_path / f"{k}.tlog", several)).of(1)
        assert (who.kind, who.multirotor, who.autopilot) == ("hexarotor", True, "PX4")


def identities_of_ulog(path: Path, *, kind: int, release: bytes) -> Identities:
    start, state = 1_000_000, "uint64_t timestamp;uint8_t system_type;uint8_t[7] _padding0;"
    parts = [writer.header(start), writer.form("vehicle_status", state)]
    parts += [writer.keyed("I", "char[3] sys_name", b"PX4"), writer.parameter("MAV_SYS_ID", 7)]
    parts += [writer.keyed("I", f"char[{len(release)}] ver_sw_release", release)]
    parts += [writer.keyed("I", "uint32_t ver_sw_release", struct.pack("<I", 0x011000FF))]
    parts += [writer.subscribe(0, "vehicle_status")]
    path.write_bytes(
        b"".join([*parts, *(writer.data(0, struct.pack("<QB", start + k, kind)) for k in range(3))])
    )
    return identities(path)


@pytest.mark.parametrize("text", [b"", b"99999999999", b"-5", b"1.5", "٣".encode()])
def test_a_ulog_names_type_and_firmware(tmp_path: Path, text: bytes) -> None:
    found = identities_of_ulog(tmp_path / "one.ulg", kind=2, release=text)
    assert found.vehicles == (7,)
    who = found.of(7)
    assert (who.multirotor, who.kind) == (True, "quadrotor")
    assert who.software == "PX4 1.16.0"


def test_an_undefined_type_in_a_ulog_is_no_type(tmp_path: Path) -> None:
    who = identities_of_ulog(tmp_path / "one.ulg", kind=200, release=b"").of(7)
    assert (who.kind, who.software) == (None, "PX4 1.16.0")


@pytest.mark.parametrize(
    ("key", "name", "known"),
    [(b"sys_name", b"PX4", "PX4"), (b"sys_name", b"other", None), (b"sys_uuid", b"PX4", None)],
)
def test_a_ulog_without_a_state_names_its_autopilot(key: bytes, name: bytes, known: str | None) -> None:
    found = heard("info", (key, name), [("name", "S16"), ("value", "S16")])
    assert found.of(1).autopilot == known
