"""Sends alerts to the ground station, as an onboard component may, and never a command.

It sends a HEARTBEAT each second, one STATUSTEXT per fault episode, and the health of each actuator as
NAMED_VALUE_FLOAT each second. An episode is an uninterrupted time in one condition.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib import import_module
from typing import Any, Final

from mavhums.core.conditions import Condition
from mavhums.engine.events import Event
from mavhums.health.decision.events import ConditionChanged
from mavhums.live.status import utc
from mavhums.log.mavlink.signing import signing_ticks
from mavhums.results.live import ActuatorStatus, AlertObject
from mavhums.vehicle.surfaces import COLUMNS

COMPONENT = 194
"""MAV_COMP_ID_ONBOARD_COMPUTER4: the least used of the numbers for onboard computers."""

TEXT_LENGTH = 50
_NAME_LENGTH = 10
_REPEAT_US = 30_000_000
_ONBOARD_CONTROLLER, _NO_AUTOPILOT, _ACTIVE = 18, 8, 4  # MAV_TYPE, MAV_AUTOPILOT, MAV_STATE
_SEVERITY: Final[dict[Condition, int]] = {"emergency": 2, "degraded": 4}  # MAV_SEVERITY
_ACTIONS: Final[dict[Condition, tuple[str, ...]]] = {
    "emergency": ("land as soon as possible", "land now"),
    "degraded": ("inspect after landing", "inspect"),
}
_HEALTH: Final[dict[Condition, float]] = {
    "normal": 1.0,
    "unchanged": 1.0,
    "changed": 0.5,
    "degraded": 0.5,
    "emergency": 0.0,
}


def text_of(actuator: str, condition: Condition, fault: str) -> str:
    """Return actuator, finding and action in at most fifty characters of ASCII.

    A finding about an axis already includes its severity.

    Examples
    --------
    >>> text_of("elevator", "emergency", "friction")
    'elevator EMERGENCY: friction, land now'
    >>> text_of("rudder", "degraded", "backlash")
    'rudder DEGRADED: backlash, inspect after landing'
    >>> text_of("roll", "emergency", "control 50%: aileron L/R?")
    'ROLL control 50%: aileron L/R?, land now'
    """
    name = actuator.encode("ascii", "replace").decode()
    finding = fault.replace("_", " ").encode("ascii", "replace").decode()
    lead = f"{name.upper()} " if actuator in COLUMNS and "?" in finding else f"{name} {condition.upper()}: "
    for action in _ACTIONS[condition]:
        text = f"{lead}{finding}, {action}"
        if len(text) <= TEXT_LENGTH:
            return text
    rest = f" {condition.upper()}: , {_ACTIONS[condition][-1]}"
    finding = finding[: max(TEXT_LENGTH - len(rest) - len(name), 8)]
    return f"{name[: TEXT_LENGTH - len(rest) - len(finding)]}{rest.replace(': ', f': {finding}', 1)}"


def fault_of(event: ConditionChanged) -> str | None:
    """Return the finding or the fault of a change to a condition that asks for an alert; else None."""
    return event.finding or event.fault if event.after in _SEVERITY else None


def health_name(number: int, actuator: str) -> str:
    """Return a name of ten characters for an actuator's health; ``number`` makes it unique.

    Examples
    --------
    >>> health_name(2, "aileron_right")
    'H2aileron_'
    """
    return f"H{number}{actuator.encode('ascii', 'replace').decode()}"[:_NAME_LENGTH]


class Signer:
    """Key and time stamps by which the frames are signed.

    Parameters
    ----------
    key
        32 bytes.
    newest_ticks
        Returns the time stamp of the newest accepted signed frame.
    """

    def __init__(self, key: bytes, newest_ticks: Callable[[], int] = lambda: 0) -> None:
        self.key, self._newest_ticks, self._ticks = key, newest_ticks, 0

    def ticks(self, now_us: int) -> int:
        """Return the next time stamp: later than every one sent or accepted, else receivers refuse it."""
        self._ticks = max(self._ticks + 1, self._newest_ticks() + 1, signing_ticks(now_us))
        return self._ticks


class Alerts:
    """Sends alerts for each judged vehicle, with its system id and a separate component id.

    Parameters
    ----------
    send
        Sends a frame about a vehicle to the receivers.
    component
        Component id.
    signer
        Signs the frames; None sends them unsigned.
    start_us
        Start of the session, microseconds of UTC.
    """

    def __init__(
        self,
        send: Callable[[bytes, int], None],
        *,
        component: int = COMPONENT,
        signer: Signer | None = None,
        start_us: int = 0,
    ) -> None:
        self.mavlink2 = True
        self._send = send
        self._component, self._signer = component, signer
        self._start_us = start_us
        self._encoders: dict[tuple[int, bool], Any] = {}
        self._pending: dict[tuple[int, str], tuple[Condition, str]] = {}
        self._sent_us: dict[tuple[int, str, Condition], int] = {}

    def observe(self, events: Iterable[Event], now_us: int) -> list[AlertObject]:
        """Send the episodes that begin; return the alerts that were sent."""
        for event in events:
            if isinstance(event, ConditionChanged):
                key = (event.vehicle, event.actuator)
                self._pending.pop(key, None)
                if fault := fault_of(event):
                    self._pending[key] = (event.after, fault)
        return list(self._announce(now_us))

    def tick(
        self, actuators: Sequence[ActuatorStatus], now_us: int, heard: Iterable[int] = ()
    ) -> list[AlertObject]:
        """Send the heartbeat and the health of each actuator; NaN if unknown.

        Only vehicles with received actuator data are reported; those of ``heard`` get a heartbeat, too.
        """
        judged = [status for status in actuators if status.age_s is not None]
        vehicles = sorted({status.vehicle for status in judged if status.vehicle})
        for vehicle in sorted({*vehicles, *heard}):
            self.heartbeat(vehicle, now_us)
        for vehicle in vehicles:
            ours = [status for status in actuators if status.vehicle == vehicle]
            for number, status in enumerate(ours, start=1):
                value = _HEALTH.get(status.condition, math.nan)
                boot_ms = (now_us - self._start_us) // 1000 % 2**32
                name = health_name(number, status.actuator).encode()
                self._transmit(vehicle, "named_value_float", now_us, boot_ms, name, value)
        return list(self._announce(now_us))

    def heartbeat(self, vehicle: int, now_us: int) -> None:
        """Send a HEARTBEAT as an onboard controller."""
        self._transmit(vehicle, "heartbeat", now_us, _ONBOARD_CONTROLLER, _NO_AUTOPILOT, 0, 0, _ACTIVE)

    def _announce(self, now_us: int) -> Iterator[AlertObject]:
        """Send pending alerts; repeat the same alert after half a minute at the earliest."""
        for (vehicle, actuator), (condition, fault) in list(self._pending.items()):
            sent_us = self._sent_us.get((vehicle, actuator, condition))
            if sent_us is not None and now_us - sent_us < _REPEAT_US:
                continue
            del self._pending[vehicle, actuator]
            self._sent_us[vehicle, actuator, condition] = now_us
            text = text_of(actuator, condition, fault)
            self._transmit(vehicle, "statustext", now_us, _SEVERITY[condition], text.encode())
            yield AlertObject(utc=utc(now_us), vehicle=vehicle, severity=_SEVERITY[condition], text=text)

    def _transmit(self, vehicle: int, message: str, now_us: int, *fields: Any) -> None:
        mavlink2 = self.mavlink2 or self._signer is not None
        encoder = self._encoders.get((vehicle, mavlink2))
        if encoder is None:
            dialect = import_module(f"pymavlink.dialects.{'v20' if mavlink2 else 'v10'}.common")
            encoder = self._encoders[vehicle, mavlink2] = dialect.MAVLink(None, vehicle, self._component)
            if self._signer is not None:
                encoder.signing.secret_key = self._signer.key
                encoder.signing.sign_outgoing = True
                encoder.signing.link_id = self._component
        if self._signer is not None:
            encoder.signing.timestamp = self._signer.ticks(now_us)
        self._send(bytes(getattr(encoder, f"{message}_encode")(*fields).pack(encoder)), vehicle)
        encoder.seq = (encoder.seq + 1) % 256
