"""Rerun streams and timelines, common to all recordings."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mavhums.results.assessment import Assessment

__all__ = ["APPLICATION", "TIMELINE", "describe", "nanoseconds", "open_stream", "send"]

APPLICATION: Final = "mavhums"
TIMELINE: Final = "flight_time"

Times = NDArray[np.float64] | Sequence[float]


def open_stream(recording_id: str) -> rr.RecordingStream:
    """Return a stream with the flight timeline and without data of the machine that writes it."""
    stream = rr.RecordingStream(APPLICATION, recording_id=recording_id, send_properties=False)
    stream.set_log_tick_enabled(False)
    stream.set_log_time_enabled(False)
    return stream


def nanoseconds(time_s: Times) -> NDArray[np.timedelta64]:
    """Return flight times as Rerun's durations."""
    rounded = np.rint(np.asarray(time_s, dtype=np.float64) * 1e9)
    return rounded.astype(np.int64).astype("timedelta64[ns]")


def send(stream: rr.RecordingStream, path: str, time_s: Times, content: rr.ComponentColumnList) -> None:
    """Write rows of one entity at flight times."""
    index = [rr.TimeColumn(TIMELINE, duration=nanoseconds(time_s))]
    stream.send_columns(path, indexes=index, columns=content, strict=True)


def describe(stream: rr.RecordingStream, assessment: Assessment, name: str) -> None:
    """Write the properties that identify a recording in a catalogue: vehicle, worst actuator, condition."""
    log = assessment.log
    stream.send_recording_name(name)
    if log.start_utc:
        start = datetime.fromisoformat(log.start_utc)
        start = start if start.tzinfo else start.replace(tzinfo=UTC)
        stream.send_recording_start_time_nanos(round(start.timestamp() * 1e6) * 1000)
    properties: dict[str, Any] = {"notice": assessment.notice, "duration_s": log.duration_s}
    if assessment.airframe:
        properties["airframe"] = assessment.airframe
    if assessment.verdicts:
        worst = assessment.ranked()[0]
        properties |= {"worst_actuator": worst.actuator, "condition": worst.gravest}
        if worst.vehicle is not None:
            properties["vehicle"] = worst.vehicle
    stream.send_property("mavhums", rr.AnyValues(**properties))
