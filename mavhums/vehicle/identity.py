"""The identity of a vehicle and of its flight: kind, autopilot, firmware, board and boot time, as reported.

Board and boot time distinguish two recordings of one flight from two flights. The board's unique id comes as
a report of its own or in a text that ArduPilot sends and logs, as the same hexadecimal digits: 12 bytes for
ArduPilot, 18 for PX4. If there is no id, the operator's serial number replaces it. ArduPilot's simulator
(SITL) sends the id of its machine, with the number of the simulated vehicle in the first byte. The boot time
is the difference between the log's dates and the vehicle's own clock.

A flight is dated by the first source whose date can be: the times of the log (of reception, or of the
satellites on board), with the step of a receiver's clock that was set while it recorded; then the vehicle's
own clocks; then the log's file, which is said. A log that no file holds and no clock dates has no date.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.log import Table
from mavhums.log.base.scanner import is_date
from mavhums.vehicle.facts import ARDUPILOT, NO_AUTOPILOT, RANGES
from mavhums.vehicle.formats import messages_of, reports
from mavhums.vehicle.formats.base import FactReport
from mavhums.vehicle.states import kind_named, texts

IDENTITY_MESSAGES: Final = messages_of(
    "autopilot", "autopilot name", "board", "boot", "firmware", "parameter", "text", "uptime"
)
"""What :class:`Identities` reads."""

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
    **dict.fromkeys(range(22, 26), "VTOL"),
    28: "parafoil",
    29: "dodecarotor",
    35: "decarotor",
    43: "multirotor",
    47: "VTOL gyrodyne",
}
_MULTIROTORS: Final = frozenset({2, 13, 14, 15, 29, 35, 43})
_MULTIROTOR: Final = 43
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
    48: "gripper",
}
"""MAV_TYPEs of what is not a vehicle, in words."""

_FIRMWARE = re.compile(
    r"((?:Ardu(?:Plane|Copter|Rover|Sub)|APM:(?:Plane|Copter|Rover|Sub)|Blimp|PX4) V?\d+(?:\.\d+){1,2}\S*)"
)
_BOARD: Final = re.compile(r"\S+ ([0-9A-F]{8}) ([0-9A-F]{8}) ([0-9A-F]{8})")
_SIMULATED: Final = re.compile(r"(.?)([0-9a-f]{31})", re.DOTALL)
_SERIAL: Final = b"BRD_SERIAL_NUM"
_BOOT_COUNT: Final = b"STAT_BOOTCNT"
_RELEASES: Final = {192: "-rc", 128: "-beta", 64: "-alpha", 0: "-dev"}
_NAMED: Final = re.compile(r"(20\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[-_.T ]+(\d\d)[-_.:]?(\d\d)[-_.:]?(\d\d)(?!\d)")
"""A date with its time of day, as loggers and ground stations name their files."""


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
        Unique id of the autopilot's board, hexadecimal, or else the operator's serial number.
    multirotor
        Whether it is a multirotor, which has no control surface.
    boots
        How often the board has booted, by its own count.

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
    boots: int | None = None

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


class BootTimes(NamedTuple):
    """A vehicle's boot by its own date, and by the log's times less its uptime, µs; None where not known."""

    dated_us: int | None
    logged_us: int | None


class Identities:
    """Follows the identities and the boot times that vehicles report, block by block.

    Examples
    --------
    >>> Identities().of(1).board is None
    True
    """

    def __init__(self) -> None:
        self._known: dict[int, Identity] = {}
        self._boards: dict[int, dict[str, str]] = {}  # the first unique id by each kind of report
        self._heard: set[int] = set()
        self._numbers: dict[tuple[int, bytes], int] = {}
        self._boots: dict[int, int] = {}
        self._rough_boots: dict[int, int] = {}

    @property
    def vehicles(self) -> tuple[int, ...]:
        """System ids whose heartbeat is a vehicle's, not a ground station's or a peripheral's."""
        return tuple(sorted(self._heard))

    @property
    def boots(self) -> list[BootTimes]:
        """The boot times of all vehicles, by both clocks."""
        return [self.boot(vehicle) for vehicle in sorted({*self._boots, *self._rough_boots})]

    def of(self, vehicle: int) -> Identity:
        """Return the known identity of a vehicle."""
        known = self._known.get(vehicle, Identity(vehicle))
        serial = self._numbers.get((vehicle, _SERIAL))
        boards = self._boards.get(vehicle, {})
        # Where a text and a report of its own differ, as of a simulator, the text has all of the id.
        board = boards.get("text") or boards.get("board") or (f"serial {serial}" if serial else None)
        return replace(known, board=board, boots=self._numbers.get((vehicle, _BOOT_COUNT)))

    def boot(self, vehicle: int) -> BootTimes:
        """Return when a vehicle booted, as known so far."""
        return BootTimes(self._boots.get(vehicle), self._rough_boots.get(vehicle))

    def feed(self, tables: Mapping[str, Table]) -> None:
        """Take the identities and the boot times in these messages."""
        self._hear_autopilots(tables)
        self._hear_texts(tables)
        self._hear_boards(tables)
        for report in reports(tables, "boot"):
            _keep_first(self._boots, report, report.values)
        # By the time of reception: some latency is in it, so that the clocks' own date comes first.
        for report in reports(tables, "uptime"):
            _keep_first(self._rough_boots, report, report.table.time_us - report.values)

    def _hear_autopilots(self, tables: Mapping[str, Table]) -> None:
        for report in reports(tables, "autopilot"):
            rows = np.column_stack([report.table.system, report.values]).astype(np.int64)
            for system, kind, autopilot in _distinct(rows):
                if autopilot != NO_AUTOPILOT and kind not in PERIPHERALS and system not in self._heard:
                    self._heard.add(system)
                    names = {"kind": _KINDS.get(kind), "autopilot": _AUTOPILOTS.get(autopilot)}
                    self._note(system, **names, multirotor=kind in _MULTIROTORS)
        for report in reports(tables, "firmware"):
            for system, number in zip(report.table.system.tolist(), report.values.tolist(), strict=True):
                if number and not self.of(system).firmware:
                    self._note(system, firmware=_version(number))
        for report in reports(tables, "autopilot name"):
            for system, name in zip(report.table.system.tolist(), report.texts, strict=True):
                if name in _AUTOPILOTS.values():
                    self._note(system, autopilot=name)

    def _hear_boards(self, tables: Mapping[str, Table]) -> None:
        for report in reports(tables, "board"):
            for system, board in zip(report.table.system.tolist(), report.texts, strict=True):
                self._boards.setdefault(system, {}).setdefault("board", board)
        for report in reports(tables, "parameter"):
            own = np.isin(report.values["name"], (_SERIAL, _BOOT_COUNT))
            names, numbers = report.values["name"][own].tolist(), report.values["bits"][own].view("<f4")
            for system, name, number in zip(report.table.system[own].tolist(), names, numbers, strict=True):
                if 1 <= number <= RANGES["parameter"][1]:
                    self._numbers.setdefault((system, name), int(number))

    def _note(self, vehicle: int, **facts: Any) -> None:
        self._known[vehicle] = replace(self._known.get(vehicle, Identity(vehicle)), **facts)

    def _hear_texts(self, tables: Mapping[str, Table]) -> None:
        for said in texts(tables):
            if board := _board_in(said.text):
                self._boards.setdefault(said.vehicle, {}).setdefault("text", board)
            match = _FIRMWARE.search(said.text)
            if match:
                self._note(said.vehicle, firmware=match[1])
            kind = kind_named(said.text)
            if kind is not None and said.vehicle not in self._heard:
                several = kind in _MULTIROTORS  # one firmware serves all numbers of rotors
                name = _KINDS.get(_MULTIROTOR if several else kind)
                self._note(said.vehicle, kind=name, autopilot=_AUTOPILOTS[ARDUPILOT], multirotor=several)


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


def _distinct(rows: NDArray[Any]) -> list[tuple[int, int, int]]:
    """Return the distinct rows of an (n, 3) array, in the order of their first appearance."""
    _, first = np.unique(rows, axis=0, return_index=True)
    return [(int(a), int(b), int(c)) for a, b, c in rows[np.sort(first)].tolist()]


def _board_in(text: str) -> str | None:
    """Return the unique id of a board in a text of the autopilot; None if it has none.

    Examples
    --------
    >>> _board_in("CubeOrange 00112233 44556677 8899AABB"), _board_in("Vd1219c7c4c5404aaa1f6d2a48adfda4")
    ('00112233445566778899AABB', 'SITL 56 D1219C7C4C5404AAA1F6D2A48ADFDA4')
    """
    match = _BOARD.fullmatch(text.strip())
    if match:
        return "".join(match.groups())
    match = _SIMULATED.fullmatch(text)
    return f"SITL {ord(match[1] or ' '):02X} {match[2].upper()}" if match else None


def _keep_first(known: dict[int, int], report: FactReport, boots: NDArray[Any]) -> None:
    for vehicle, row in zip(*np.unique(report.table.system, return_index=True), strict=True):
        known.setdefault(int(vehicle), int(boots[row]))


def date_shift_us(first_us: int, ahead_us: int | None, boots: Iterable[BootTimes]) -> int | None:
    """Return what must be added to a log's times for UTC, microseconds; None if nothing dates it.

    Parameters
    ----------
    first_us
        The log's first time.
    ahead_us
        By how much the clock of the log's times was set later; None if they count from boot.
    boots
        Of its vehicles.

    Examples
    --------
    >>> date_shift_us(1_700_000_000_000_000, 0, ()), date_shift_us(5, 0, ()), date_shift_us(5, None, ())
    (0, None, None)
    >>> date_shift_us(5_000_000, 0, [BootTimes(1_700_000_000_000_000, 2_000_000)])
    1699999998000000
    """
    if ahead_us is not None and is_date(first_us + ahead_us):
        return ahead_us
    shifts = (
        dated - logged for dated, logged in boots if dated is not None and logged is not None
    )  # the two clocks name one moment
    return next((shift for shift in shifts if is_date(first_us + shift)), None)


def date_of_file(path: str, duration_s: float) -> tuple[datetime, str] | None:
    """Return when the log in a file began, by its name or else by its time, and that this is so.

    None if there is no such file, and no date in its name.

    Examples
    --------
    >>> began, said = date_of_file("2022-05-24_15-52-12.tlog", 60.0)
    >>> began.isoformat(), said.partition(":")[0]
    ('2022-05-24T15:52:12+00:00', 'dated by the name of its file')
    """
    said = "dated by the {} of its file: the log has no date"
    if match := _NAMED.search(Path(path).name):
        try:
            return datetime(*map(int, match.groups()), tzinfo=UTC), said.format("name")  # type: ignore[misc,arg-type]
        except ValueError:  # no such day
            pass
    try:
        ended_s = Path(path).stat().st_mtime
    except (OSError, ValueError):
        return None
    if not is_date((ended_s - duration_s) * 1e6):
        return None
    return datetime.fromtimestamp(ended_s - duration_s, UTC), f"{said.format('time')}; copying may change it"
