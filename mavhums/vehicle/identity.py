"""The identity of a vehicle: its type, autopilot, firmware and board, as the vehicle reports them.

HEARTBEAT reports type and autopilot. AUTOPILOT_VERSION reports firmware and board, but only to a ground
station that requests it; ArduPilot and PX4 also report their firmware in a STATUSTEXT. A ULog has the type in
vehicle_status and the firmware among its information records.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.log import Table
from mavhums.vehicle.modes import kind_of
from mavhums.vehicle.texts import TEXT_MESSAGES, texts

__all__ = ["IDENTITY_MESSAGES", "PERIPHERALS", "Identities", "Identity", "in_words"]

IDENTITY_MESSAGES: Final = (
    frozenset({"HEARTBEAT", "AUTOPILOT_VERSION", "vehicle_status", "info"}) | TEXT_MESSAGES
)
"""What :class:`Identities` reads."""

_NO_AUTOPILOT: Final = 8  # MAV_AUTOPILOT_INVALID: a camera, a gimbal, a ground station
_AUTOPILOTS: Final = {3: "ArduPilot", 4: "OpenPilot", 9: "Paparazzi", 12: "PX4", 13: "SMACCMPilot"}
_KINDS: Final = {
    1: "fixed wing",
    2: "quadrotor",
    3: "coaxial helicopter",
    4: "helicopter",
    7: "airship",
    8: "free balloon",
    9: "rocket",
    10: "ground rover",
    11: "surface boat",
    12: "submarine",
    13: "hexarotor",
    14: "octorotor",
    15: "tricopter",
    16: "flapping wing",
    17: "kite",
    19: "VTOL duorotor",
    20: "VTOL quadrotor",
    21: "VTOL tiltrotor",
    22: "VTOL",
    23: "VTOL",
    24: "VTOL",
    25: "VTOL",
    28: "parafoil",
    29: "dodecarotor",
    35: "decarotor",
    43: "multirotor",
    47: "VTOL gyrodyne",
}
_MULTIROTORS: Final = frozenset({2, 13, 14, 29, 35, 43})
_MULTIROTOR: Final = 43
_ARDUPILOT: Final = 3
_PX4: Final = 12
_SYSTEM_NAME, _RELEASE = b"sys_name", b"ver_sw_release"
PERIPHERALS: Final = {
    5: "antenna tracker",
    6: "ground station",
    18: "companion computer",
    26: "gimbal",
    27: "ADS-B receiver",
    30: "camera",
    31: "charging station",
    32: "FLARM receiver",
    33: "servo",
    34: "remote ID module",
    36: "battery",
    37: "parachute",
    38: "logger",
    39: "on-screen display",
    40: "IMU",
    41: "GPS receiver",
    42: "winch",
    44: "illuminator",
    48: "generic peripheral",
}
"""MAV_TYPEs of what is no vehicle, in words."""

_FIRMWARE = re.compile(
    r"((?:Ardu(?:Plane|Copter|Rover|Sub)|APM:(?:Plane|Copter|Rover|Sub)|Blimp|PX4) V?\d+(?:\.\d+){1,2}\S*)"
)
_RELEASES: Final = {255: "", 192: "-rc", 128: "-beta", 64: "-alpha", 0: "-dev"}


@dataclass(frozen=True, slots=True)
class Identity:
    """The identity that a vehicle reports; None for what it does not report.

    Attributes
    ----------
    vehicle
        System id.
    kind
        Type of vehicle in words, for example ``fixed wing``.
    autopilot
        For example ``ArduPilot``.
    firmware
        Name or version, for example ``ArduPlane V4.5.7``.
    board
        Unique id of the autopilot's board, hexadecimal.
    multirotor
        Whether it is a multirotor, which has no control surface.

    Examples
    --------
    >>> str(Identity(1, "fixed wing", "ArduPilot", "ArduPlane V4.5.7"))
    'fixed wing, ArduPlane V4.5.7'
    """

    vehicle: int
    kind: str | None = None
    autopilot: str | None = None
    firmware: str | None = None
    board: str | None = None
    multirotor: bool = False

    @property
    def software(self) -> str | None:
        """The firmware with the autopilot's name; None if neither is known.

        Examples
        --------
        >>> Identity(1, autopilot="PX4", firmware="1.16.0").software
        'PX4 1.16.0'
        """
        if self.firmware and self.firmware[0].isdigit():
            return f"{self.autopilot or 'firmware'} {self.firmware}"
        return self.firmware or self.autopilot

    def __str__(self) -> str:
        return ", ".join(part for part in (self.kind, self.software) if part)


class Identities:
    """Follows the identities that vehicles report, block by block.

    Examples
    --------
    >>> Identities().of(1)
    Identity(vehicle=1, kind=None, autopilot=None, firmware=None, board=None, multirotor=False)
    """

    def __init__(self) -> None:
        self._known: dict[int, Identity] = {}
        self._heard: set[int] = set()

    @property
    def vehicles(self) -> tuple[int, ...]:
        """System ids whose heartbeat is a vehicle's, not a ground station's or a peripheral's."""
        return tuple(sorted(self._heard))

    def of(self, vehicle: int) -> Identity:
        """Return the known identity of a vehicle."""
        return self._known.get(vehicle, Identity(vehicle))

    def feed(self, tables: Mapping[str, Table]) -> None:
        """Take the identities in these messages."""
        self._heartbeats(tables.get("HEARTBEAT"))
        self._versions(tables.get("AUTOPILOT_VERSION"))
        self._statuses(tables.get("vehicle_status"))
        self._information(tables.get("info"))
        self._texts(tables)

    def _heartbeats(self, table: Table | None) -> None:
        if table is None:
            return
        beats = np.stack([table.system, table["type"], table["autopilot"]], axis=1)
        for system, kind, autopilot in _distinct(beats):
            if autopilot == _NO_AUTOPILOT or kind in PERIPHERALS or system in self._heard:
                continue
            self._is(system, kind, autopilot)

    def _statuses(self, table: Table | None) -> None:
        if table is None or not table.holds({"system_type": 1}):
            return
        for k in _first_of_each(table.system):
            system, kind = int(table.system[k]), float(table["system_type"][k])
            if kind in _KINDS and system not in self._heard:
                self._is(system, int(kind), _PX4)

    def _is(self, system: int, kind: int, autopilot: int) -> None:
        self._heard.add(system)
        self._known[system] = replace(
            self.of(system),
            kind=_KINDS.get(kind),
            autopilot=_AUTOPILOTS.get(autopilot),
            multirotor=kind in _MULTIROTORS,
        )

    def _information(self, table: Table | None) -> None:
        """Take name and release of the firmware from a ULog's information records."""
        if table is None or not (table.holds_text("name") and table.holds_text("value")):
            return
        told = table.select(np.isin(table["name"], (_SYSTEM_NAME, _RELEASE)))
        names, values = told["name"].tolist(), told.texts("value")
        for system, name, value in zip(told.system.tolist(), names, values, strict=True):
            known = self.of(system)
            if name == _SYSTEM_NAME and value in _AUTOPILOTS.values():
                self._known[system] = replace(known, autopilot=value)
            elif (
                name == _RELEASE
                and value.isascii()
                and value.isdecimal()
                and len(value) <= 10
                and 0 < int(value) < 2**32
            ):
                self._known[system] = replace(known, firmware=known.firmware or _version(int(value)))

    def _versions(self, table: Table | None) -> None:
        if table is None:
            return
        for k in _first_of_each(table.system):
            vehicle = int(table.system[k])
            uid2 = bytes(table["uid2"][k].tolist())
            uid = int(table["uid"][k])
            version, known = int(table["flight_sw_version"][k]), self.of(vehicle)
            self._known[vehicle] = replace(
                known,
                board=uid2.hex() if any(uid2) else f"{uid:016x}" if uid else known.board,
                firmware=known.firmware or (_version(version) if version else None),
            )

    def _texts(self, tables: Mapping[str, Table]) -> None:
        for said in texts(tables):
            match = _FIRMWARE.search(said.text)
            if match:
                self._known[said.vehicle] = replace(self.of(said.vehicle), firmware=match[1])
            kind = kind_of(said.text)
            if kind is not None and said.vehicle not in self._heard:
                several = kind in _MULTIROTORS  # one firmware serves all numbers of rotors
                self._known[said.vehicle] = replace(
                    self.of(said.vehicle),
                    kind=_KINDS.get(_MULTIROTOR if several else kind),
                    autopilot=_AUTOPILOTS[_ARDUPILOT],
                    multirotor=several,
                )


def in_words(kind: int) -> str:
    """Return a MAV_TYPE in words, with its article.

    Examples
    --------
    >>> in_words(2), in_words(14), in_words(18), in_words(46)
    ('a quadrotor', 'an octorotor', 'a companion computer', 'a vehicle of MAV_TYPE 46')
    """
    name = _KINDS.get(kind) or PERIPHERALS.get(kind)
    if name is None:
        return f"a vehicle of MAV_TYPE {kind}"
    return f"{'an' if name[0] in 'aeioAEIO' else 'a'} {name}"


def _version(number: int) -> str:
    """Return a version as text.

    Examples
    --------
    >>> _version(0x040507FF)
    '4.5.7'
    """
    major, minor, patch, release = number.to_bytes(4, "big")
    return f"{major}.{minor}.{patch}{_RELEASES.get(release, '')}"


def _distinct(rows: NDArray[np.uint8]) -> list[tuple[int, int, int]]:
    """Return the distinct rows of an (n, 3) array, in the order of their first appearance."""
    _, first = np.unique(rows, axis=0, return_index=True)
    return [(int(a), int(b), int(c)) for a, b, c in rows[np.sort(first)].tolist()]


def _first_of_each(values: NDArray[np.uint8]) -> list[int]:
    return [int(k) for k in np.sort(np.unique(values, return_index=True)[1])]
