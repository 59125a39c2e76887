"""Sections of an assessment: servo usage, a network's answer, limits, identity and events of the flight."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Final, Literal, get_args

from pydantic import Field, model_validator

from mavhums.core.conditions import Condition
from mavhums.core.models import Contract


class OutputUsage(Contract):
    """How far and how often one servo output was commanded.

    ``commanded`` is whether it ever moved. Shares are of the calibrated range; they are null where neither
    the log's parameters nor a profile give that range. The times at the stops and the mean count while the
    vehicle is armed, or where its state is unknown. ``bearing_deg`` is the direction of a multirotor's motor,
    clockwise from the nose; it is null for an output that drives none.
    """

    servo: int
    name: str | None
    named_by: str | None
    commanded: bool
    range_us: tuple[int, int, int] | None
    least_us: int | None
    greatest_us: int | None
    span: float | None = Field(ge=0)
    travelled_us: int = Field(ge=0)
    travelled: float | None = Field(ge=0)
    reversals: int = Field(ge=0)
    held_s: float = Field(ge=0)
    at_low_s: float | None = Field(ge=0)
    at_high_s: float | None = Field(ge=0)
    mean_us: float | None
    bearing_deg: float | None = None


class VehicleUsage(Contract):
    """Usage of one vehicle in a log.

    ``armed_s`` is null where the log does not record the arming state, or none before a disarming;
    ``forward_s`` counts the seconds in forward flight as a fixed wing, of a rover or a boat those of driving
    forward.
    """

    vehicle: int
    kind: str | None
    firmware: str | None
    armed_s: float | None = Field(ge=0)
    forward_s: float = Field(ge=0)
    outputs: tuple[OutputUsage, ...]


Decide = Literal["physics", "network", "both"]
"""Who decides an actuator's friction; with ``both`` the physics, and a network's disagreement is reported."""
DECIDE: tuple[Decide, ...] = get_args(Decide)


class ModelSummary(Contract):
    """A network whose votes are among the evidence."""

    name: str
    hash: str


def fault_of(said: str) -> str:
    """Return the fault that a class of windows is, as the detectors name it.

    Examples
    --------
    >>> fault_of("friction_degraded"), fault_of("backlash")
    ('friction', 'backlash')
    """
    return "friction" if said.startswith("friction") else said


_Probability = Annotated[float, Field(ge=0, le=1)]


class WindowsOfClass(Contract):
    """How many windows a network put in one class, and the mean probability of that class in them.

    The windows that it ``abstained`` on, or that lie ``outside`` its training range, have the mean
    probability of the likeliest class.
    """

    windows: int = Field(ge=1)
    probability: _Probability


class NetworkAnswer(Contract):
    """Answer of a network for one actuator and flight, beside the physics or instead of it.

    ``inputs`` are the quantities of which the network of samples takes values, and that of windows
    statistics. ``windows`` is the number of ten-second windows that it decided, ``classes`` what it said of
    all that it was asked about, the most frequent first; ``condition`` is the gravest that two windows
    without a common sample, and those between, agreed on, ``says`` the likeliest class there, and ``latest``
    what it said of the last window, with its ``probability``. ``first_emergency_s`` is the middle of the
    first window in which it finds an emergency, ``share_of_samples`` the share of the samples in motion
    within its training range that it calls an emergency by friction. ``decides`` is who decided the verdict:
    ``physics``, ``network``, or ``both``, where the physics decides and a different answer of the network is
    reported.
    """

    model: ModelSummary
    inputs: dict[Literal["samples", "windows"], tuple[str, ...]]
    windows: int = Field(ge=0)
    classes: dict[str, WindowsOfClass]
    says: str | None
    latest: str
    probability: _Probability
    first_emergency_s: float | None
    share_of_samples: _Probability
    condition: Condition = "undecided"
    decides: Decide = "physics"


_Share = Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)]
_Deviations = Annotated[float, Field(ge=3, le=1000, allow_inf_nan=False)]


class AxisLimits(Contract):
    """Limits of the axes: control effectiveness, lag, trim and tracking."""

    # One of two equal surfaces that keeps 60 % of its effect leaves the first share. Deviations are a quarter
    # above the highest of healthy flights, whose trim scatters by 0.01 to 0.02 of the full demand.
    effectiveness_degraded: _Share = Field(
        default=0.8,
        description="Share of the reference's control effectiveness below which a certain loss is degraded.",
    )
    effectiveness_emergency: _Share = Field(
        default=0.65,
        description="The same, up to which it is an emergency, if that is 95 % probable. One of two equal "
        "surfaces that no longer moves leaves 45 to 65 %.",
    )
    lag_s: Annotated[float, Field(ge=0.1, le=5, allow_inf_nan=False)] = Field(
        default=0.3,
        description="Additional lag from which a servo is slow, s.",
    )
    trim_deviations: _Deviations = Field(
        default=6.5,
        description="Roll rate that no demand explains over three seconds, in standard deviations of the "
        "reference, from which a surface is deflected.",
    )
    trim_shift: _Share = Field(
        default=0.1,
        description="Change of the roll trim from the earlier flights, as a share of the full demand.",
    )
    roll_tracking_deviations: _Deviations = Field(
        default=8.0,
        description="Distance of the roll angle from its demand, in standard deviations of the flight's "
        "beginning.",
    )
    pitch_tracking_deviations: _Deviations = Field(
        default=7.5,
        description="The same of the pitch angle.",
    )

    @model_validator(mode="after")
    def _ordered(self) -> AxisLimits:
        if self.effectiveness_emergency >= self.effectiveness_degraded:
            raise ValueError("effectiveness_emergency must lie below effectiveness_degraded")
        return self


EventKind = Literal[
    "crash",
    "impact",
    "altitude_loss",
    "fault",
    "failsafe",
    "reboot",
    "supply",
    "telemetry_ends",
    "contact",
    "errors",
    "begins_in_air",
    "ends_in_air",
    "take_off",
    "landing",
    "armed",
    "disarmed",
    "mode",
]
"""What happened; the kinds that a short answer names first come first."""

IMPORTANCE: Final[tuple[EventKind, ...]] = get_args(EventKind)


class FlightEvent(Contract):
    """Something that happened in a flight.

    ``time_s`` counts from the first record of the log, ``subject`` is what it happened to, where that is not
    the vehicle: an actuator, an ESC. ``said`` is what the vehicle itself named: its mode, its text, a fault.
    ``value`` is the number that decided, in the unit that the kind has: of ``supply`` the lowest voltage of
    the servo rail, of ``telemetry_ends`` the seconds for which it was missing in the air, of
    ``altitude_loss`` the metres that it sank below the altitude that its autopilot demanded, of ``impact``
    those that a wing sank in the last four seconds before it came to rest, of ``fault`` how often it was
    reported, of ``errors`` how many the subject counted within the log.
    """

    kind: EventKind
    vehicle: int
    time_s: float = Field(description="Flight time, s.")
    subject: str | None = None
    said: str | None = None
    value: float | None = None


NOT_COMPARED = "not compared with earlier flights"
"""How the notice begins that says why."""

CLOCKS_APART_S = 30.0
"""Two recordings of one flight differ by at most this much in the boot time."""


class FlightIdentity(Contract):
    """The flight that a log records, so that two recordings of it count once.

    Attributes
    ----------
    vehicle
        Its id on MAVLink.
    board
        Unique id of its autopilot's board, or the operator's serial number; None if the log has neither.
    boot_utc
        When the autopilot was switched on; None if the log has no date.
    start_utc, end_utc
        Of the log; None if it has no date.
    aircraft
        Name of the aircraft by the operator's table or rule; None if they name none.
    boots
        How often the board has booted, by its own count; None if it does not count.

    Examples
    --------
    >>> sent = FlightIdentity(vehicle=1, board="0A", boot_utc="2026-01-01T09:00:00+00:00")
    >>> logged = sent.model_copy(update={"boot_utc": "2026-01-01T09:00:02+00:00"})
    >>> sent.is_same(logged), sent.is_same(logged.model_copy(update={"board": None}))
    (True, False)
    """

    vehicle: int
    board: str | None = None
    boot_utc: str | None = None
    start_utc: str | None = None
    end_utc: str | None = None
    aircraft: str | None = None
    boots: int | None = None

    def is_same(self, other: FlightIdentity) -> bool:
        """Return whether both are recordings of one flight.

        They are if vehicle, known board and boot time agree, and the shorter recording lies at least half
        within the longer one. An aircraft may fly several times without being switched off, and each flight
        may have its own log; then the boot times agree, but the recordings do not overlap.

        The clocks of a ground station and of a satellite receiver may differ by half a minute. Therefore the
        overlap is that of the times since boot, from which the difference of the clocks cancels.
        """
        if self.board is None or (self.vehicle, self.board) != (other.vehicle, other.board):
            return False
        if self.boot_utc is None or other.boot_utc is None:
            return False
        boots = datetime.fromisoformat(self.boot_utc), datetime.fromisoformat(other.boot_utc)
        if abs((boots[0] - boots[1]).total_seconds()) > CLOCKS_APART_S:
            return False
        return _overlap(self._since_boot(boots[0]), other._since_boot(boots[1]))

    def _since_boot(self, boot: datetime) -> tuple[float, float] | None:
        """Return start and end of the log, seconds since boot; None if they are unknown."""
        if self.start_utc is None or self.end_utc is None:
            return None
        start, end = datetime.fromisoformat(self.start_utc), datetime.fromisoformat(self.end_utc)
        return (start - boot).total_seconds(), (end - boot).total_seconds()


class FlightCopy(Contract):
    """Another log of the same flight of a vehicle.

    Attributes
    ----------
    vehicle
        Its id on MAVLink.
    log, sha256
        Path and hash of the other log; None if they are unknown.
    counts
        Whether the other log counts rather than this one.
    """

    vehicle: int
    log: str | None
    sha256: str | None
    counts: bool


def _overlap(one: tuple[float, float] | None, other: tuple[float, float] | None) -> bool:
    """Return whether the shorter of two spans lies at least half within the other."""
    if one is None or other is None:
        return True
    common = min(one[1], other[1]) - max(one[0], other[0])
    shorter = min(one[1] - one[0], other[1] - other[0])
    return common >= 0.0 and 2.0 * common >= shorter
