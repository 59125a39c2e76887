"""The vocabulary of facts: what a vehicle did, was commanded and said, in SI units, for all log formats.

:mod:`mavhums.vehicle.formats` says where each format keeps a fact. Whatever uses a fact names the fact, never
a message, a record or a topic.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from mavhums.core.arrays import Array, Integers
from mavhums.log.base.scanner import YEAR_2010_US, YEAR_2100_US

ARDUPILOT: Final = 3  # MAV_AUTOPILOT_ARDUPILOTMEGA
NO_AUTOPILOT: Final = 8  # MAV_AUTOPILOT_INVALID: a camera, a gimbal, a ground station
PX4: Final = 12  # MAV_AUTOPILOT_PX4
ON_GROUND, IN_AIR = 1, 2  # MAV_LANDED_STATE
FIXED_WING: Final = 1  # MAV_TYPE

OUTPUTS: Final = 16
"""Servo outputs of the first message, whose use is followed."""

ALL_OUTPUTS: Final = 32
"""Servo outputs that can move a surface."""

FIRST_UAVCAN_OUTPUT: Final = 33
"""Outputs from this one on are PX4's on UAVCAN, which count from 0 to 1000 and are not pulses."""

CONTINUOUS: Final[Mapping[str, int]] = {
    "outputs": OUTPUTS,  # pulses, µs, NaN where an output is off
    "outputs_2": ALL_OUTPUTS,  # those that a second and a third message carry, NaN for the others
    "outputs_3": ALL_OUTPUTS,
    "rates": 3,  # roll, pitch, yaw rate, rad/s
    "force": 3,  # specific force, forward, right, down, m/s²
    "mixer": 4,  # what the mixer of a multirotor was asked for: roll, pitch, yaw, thrust, shares of full
    "attitude": 3,  # roll, pitch, yaw, rad
    "demand": 2,  # commanded roll and pitch, rad
    "airspeed": 1,  # m/s
    "velocity": 3,  # over ground, north, east and down, m/s
    "groundspeed": 1,  # m/s
    "altitude": 1,  # above where it started or above sea level, m
    "altitude error": 1,  # how far it is below the altitude that its autopilot demands, m
}
"""Signals that change steadily, and their number of columns."""

STEPPED: Final[Mapping[str, int]] = {
    "state": 4,  # MAV_TYPE, MAV_AUTOPILOT, armed, number of the mode
    "vtol": 1,  # MAV_VTOL_STATE
    "landed": 1,  # MAV_LANDED_STATE
    "airspeed sensor": 1,  # whether the vehicle has one
}
"""Signals that hold until the next value."""

SIGNALS: Final = (*CONTINUOUS, *STEPPED)

REPORTS: Final[Mapping[str, str]] = {
    "armed": "autopilot (MAV_AUTOPILOT) and whether armed, where kind and mode are recorded apart; (n, 2)",
    "arming": "the same at the changes alone; (n, 2)",
    "mode": "autopilot, MAV_TYPE (-1 unknown), base mode and number of the mode; (n, 4)",
    "autopilot": "MAV_TYPE and MAV_AUTOPILOT; (n, 2)",
    "autopilot name": "name of the autopilot; text (n,)",
    "firmware": "version, one byte each: major, minor, patch, kind of release; (n,)",
    "board": "unique id of the board, upper-case hexadecimal; text (n,)",
    "boot": "UTC at boot by the vehicle's own clocks, µs; (n,)",
    "uptime": "time since boot, µs; (n,)",
    "text": "what the autopilot says; text (n,)",
    "parameter": "fields name (text), bits (of the 32-bit value) and type (MAV_PARAM_TYPE); (n,)",
    "position": "latitude and longitude, degrees, and altitude above sea level, m; (n, 3)",
    "sensed airspeed": "airspeed of the sensor, not validated by the autopilot, m/s; (n, 1)",
    "ESC errors": "errors that an ESC counts, a column for each ESC from ``first`` on; (n, k)",
    "ESC faults": "bits of ``FAULTS``, a column for each ESC from ``first`` on; (n, k)",
    "ESC telemetry": "the same",
    "ESC links": "the same",
    "servo flags": "the same, a column for each servo",
    "motor faults": "the same, a column for each motor",
    "supply faults": "bits of ``FAULTS``; (n, 1)",
    "autopilot faults": "the same",
    "servo rail": "voltage of the rail that feeds the servos, V; (n, 1)",
    "named value": "name of a value that a script or the autopilot sends; text (n,)",
    "script value": "name of a number that a script sends and a profile can map; text (n,)",
}
"""Facts that are no signals, with the meaning and the shape of their values."""


class Faults(NamedTuple):
    """How the bits of a fact that a device reports about itself are named.

    Attributes
    ----------
    subject
        Who reports; ``{n}`` is its number, from 1.
    words
        What is reported, by bit.
    from_start
        Whether a bit counts that is set from the first reading on. One that means another state, or is wired
        to nothing on some boards, counts where it rises.
    """

    subject: str
    words: tuple[str, ...]
    from_start: bool = True


FAULTS: Final[Mapping[str, Faults]] = {
    "ESC faults": Faults(
        "ESC {n}",
        (
            "over-current",
            "over-voltage",
            "over-temperature",
            "over-speed",
            "an inconsistent command",
            "a stuck motor",
            "a fault",
            "a warning of motor temperature",
            "a warning of ESC temperature",
            "ESC over-temperature",
            "an alert (demagnetisation)",
            "a warning (desynchronisation)",
            "an error (stall)",
        ),
    ),
    "ESC telemetry": Faults("the autopilot", ("errors in most of ESC {n}'s telemetry",), from_start=False),
    "ESC links": Faults("the autopilot", ("ESC {n} offline",), from_start=False),
    "servo flags": Faults(
        "servo {n}", tuple(f"error flag 0x{1 << k:02X}" for k in range(8)), from_start=False
    ),
    "motor faults": Faults("the autopilot", ("a failure of motor {n}",)),
    "supply faults": Faults(
        "the autopilot",
        (
            "loss of its main supply",
            "loss of the servo rail's supply",
            "over-current of its peripherals",
            "over-current of its high-power peripherals",
        ),
        from_start=False,
    ),
    "autopilot faults": Faults(
        "the autopilot",
        (
            "unhealthy motor outputs",
            "unhealthy propulsion",
            "ESCs that do not arm",
            "an unbalanced propeller",
            "a motor failure",
        ),
    ),
}
"""Faults that devices report; a source's row translates its format's bits into these."""

RANGES: Final[Mapping[str, tuple[float, float]]] = {
    **dict.fromkeys(("mixer", "attitude", "demand"), (-1e3, 1e3)),
    **dict.fromkeys(("rates", "airspeed", "sensed airspeed", "velocity", "groundspeed"), (-1e4, 1e4)),
    "force": (-1e5, 1e5),
    **dict.fromkeys(("altitude", "altitude error", "position"), (-1e6, 1e6)),
    **dict.fromkeys(("vtol", "landed", "armed", "arming", "autopilot"), (0, 255)),
    "state": (0, 2**32),
    "mode": (-1, 2**32),
    "firmware": (0, 2**32 - 1),
    "boot": (YEAR_2010_US, YEAR_2100_US),
    "uptime": (0, YEAR_2100_US),
    "parameter": (-(2**32), 2**32),
    "ESC speed": (-1e7, 1e7),
    "ESC errors": (0, 2**32),
}
"""Least and greatest value of a fact, in its unit; beyond, it is damage or forged.

Wide enough for a wrong unit, which other rules find; narrow enough that nothing computed from it overflows. A
value outside is not measured: :attr:`mavhums.vehicle.formats.base.FactReport.values` is the one place.
"""


class Signal(NamedTuple):
    """New values of one signal of one vehicle.

    Attributes
    ----------
    source
        Message or record, as a verdict names it.
    frame
        Positions in the log, shape (n,), increasing.
    time_us
        Microseconds of UTC, shape (n,).
    values
        Shape (n, columns of the signal), NaN where unknown.
    stamped
        Whether the samples carry their own times; those without are never earlier than their sender's others.
    rank
        Place of its source among those of the same signal, the preferred one first.
    """

    vehicle: int
    name: str
    source: str
    frame: Integers
    time_us: Integers
    values: Array
    stamped: bool = True
    rank: int = 0


class ServoIds(NamedTuple):
    """How the messages of a log name one servo.

    Attributes
    ----------
    servo
        Its output channel, from 1.
    esc
        Its ESC, from 0; None if no ESC reports on it.
    record
        Number of its servo telemetry records; None if it follows from the channel.
    """

    servo: int
    esc: int | None = None
    record: int | None = None


class ServoReading(NamedTuple):
    """New values of one servo from one source.

    Attributes
    ----------
    servo
        Its output channel.
    source
        Message and instance, as verdicts name them: ``ESC_STATUS[3]``.
    fields
        The field of each quantity: V1…V12, or ``pulse``, the command in µs (a count on UAVCAN).
    frame, time_us
        Positions in the log and microseconds of UTC, shape (n,), increasing.
    values
        Shape (n, k), NaN where not measured, in the order of ``fields``.
    signed
        Whether the values are signed; otherwise they are magnitudes.
    """

    vehicle: int
    servo: int
    source: str
    fields: Mapping[str, str]
    frame: Integers
    time_us: Integers
    values: Array
    signed: bool = True
