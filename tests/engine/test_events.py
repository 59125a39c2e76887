"""Which events a log brings about, and what is counted beside them."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.actuator.mapping import Samples
from mavhums.engine.axes import with_drops
from mavhums.engine.events import Event, Notice
from mavhums.health.decision.events import Indication, Trace
from mavhums.log.base.decoder import Losses
from mavhums.vehicle.states import Attitude, Position
from mavhums_sim import Flight, fly
from mavhums_sim.telemetry import messages
from tests.judge import judged
from tests.strategies import START_US

REBOOT_S = 11.0
JUMPED = "its clock jumped: it rebooted, or its time was set"
TIMED = {"time_usec": 1_000_000, "time_boot_ms": 1000}


def rebooted(message: Any, time_s: float) -> Any:
    """Return the message as a vehicle sends it whose clock starts anew in flight."""
    for field, unit in TIMED.items():
        if time_s > REBOOT_S and field in message.fieldnames:
            setattr(message, field, getattr(message, field) + 3_600 * unit)
    return message


def two_vehicles() -> bytes:
    """Two vehicles of several tiers; of one the clock jumps; both say things; garbage lies between."""
    out: list[tuple[int, bytes]] = []
    tiers = {1: ("esc-unsigned", "pwm", "named"), 2: ("instrumented",)}
    for system, kinds in tiers.items():
        link = v2.MAVLink(None, srcSystem=system, srcComponent=1)
        flight = Flight(30 + system, 22.0, {"elevator": (0.2, 1.6)}, rate_hz=20.0, tiers=kinds)
        for time_s, message in messages(fly(flight)):
            sent = rebooted(message, time_s) if system == 2 else message
            out.append((START_US + round(time_s * 1e6) + system, bytes(sent.pack(link))))
    out.append((START_US + 5_000_000, b"\xfd garbage"))
    return b"".join(struct.pack(">Q", time_us) + data for time_us, data in sorted(out))


def canonical(events: Iterable[Event]) -> dict[Any, Any]:
    """Return the events of each subject in their order; rows that blocks cut are joined.

    Notices have no order: each block's come after what it judged, so two of them may swap.
    """
    by_subject: dict[Any, list[Any]] = {}
    for event in events:
        whose = tuple(getattr(event, name, None) for name in ("vehicle", "actuator", "fault", "kind"))
        by_subject.setdefault((type(event).__name__, *whose), []).append(event)
    return {key: _joined(several) for key, several in by_subject.items()}


def _joined(events: list[Any]) -> Any:
    fields = {
        Samples: ("time_s", "values"),
        Indication: ("end_s", "value", "low", "high"),
        Trace: ("time_s", "values"),
        Attitude: ("time_s", "roll_pitch_yaw_rad"),
        Position: ("time_s", "latitude_longitude_deg", "altitude_m"),
    }.get(type(events[0]))
    if fields is None:
        lines = [repr(event) for event in events]
        return sorted(lines) if type(events[0]) is Notice else lines
    return [np.concatenate([getattr(event, name) for event in events]).tobytes() for name in fields]


@pytest.mark.slow
def test_a_jump_of_the_clock_is_reported_where_it_is() -> None:
    _, events = judged(two_vehicles(), size=4096)
    notices = [event for event in events if isinstance(event, Notice) and event.text == JUMPED]
    assert [event.vehicle for event in notices] == [2]
    assert notices[0].time_s == pytest.approx(REBOOT_S, abs=0.5)


def test_what_is_left_out_is_counted_by_message_over_all_senders() -> None:
    clocks = SimpleNamespace(copies=Counter(A=5, B=1, C=0), broken=Counter(B=9))
    received = {
        1: {"A": SimpleNamespace(late=2, repeated=0), "B": SimpleNamespace(late=0, repeated=7)},
        2: {"A": SimpleNamespace(late=3, repeated=0), "B": SimpleNamespace(late=1, repeated=1)},
    }
    axes = SimpleNamespace(vehicles=lambda: [1, 2], received=received.__getitem__)
    losses = with_drops(Losses(), cast(Any, clocks), cast(Any, axes))
    assert losses.late_samples == {"A": 5, "B": 1}
    assert losses.same_time_samples == {"B": 8}
    assert losses.broken_stamps == {"B": 9}
    assert losses.copies == {"A": 5, "B": 1}
