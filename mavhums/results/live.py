"""The output of ``mavhums live --json``: one object per line, distinguished by ``event``.

The JSON schema is stored in ``mavhums/results/schema/live-1.json`` and is generated from these classes by
``python -m mavhums.results.live``.
"""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from mavhums.core.conditions import Condition
from mavhums.core.models import Contract
from mavhums.results.assessment import Assessment, published_schema
from mavhums.results.verdict import Interval, Suspect


class _Event(Contract):
    """``utc`` is when the line was written."""

    utc: str


class StartObject(_Event):
    """The session begins: its links, its profile, and the file of its recording."""

    event: Literal["start"] = "start"
    schema_: Literal["mavhums.live/1"] = Field(default="mavhums.live/1", alias="schema")
    notice: str
    version: str
    links: tuple[str, ...]
    airframe: str | None
    record: str | None
    signed_only: bool


class AirframeObject(_Event):
    """The profile with which a vehicle, every one if null, is judged from now on."""

    event: Literal["airframe"] = "airframe"
    time_s: float
    vehicle: int | None
    airframe: str


class NoticeObject(_Event):
    """A text from the vehicle, or about its telemetry."""

    event: Literal["notice"] = "notice"
    time_s: float
    vehicle: int | None
    text: str


class WindowObject(_Event):
    """Estimates from ten seconds of one actuator; null where there is not enough evidence."""

    event: Literal["window"] = "window"
    vehicle: int
    actuator: str
    start_s: float
    end_s: float
    moving_fraction: float
    friction_nm: Interval | None
    condition: Condition
    network: str | None
    probability: float | None


class ConditionObject(_Event):
    """An actuator's condition changed: since ``since_s``, certain at ``time_s``."""

    event: Literal["condition"] = "condition"
    vehicle: int
    actuator: str
    time_s: float
    since_s: float
    before: Condition
    after: Condition
    fault: str | None
    rule: str


class StaleObject(_Event):
    """An actuator's telemetry stopped, ``age_s`` ago, or resumed."""

    event: Literal["stale"] = "stale"
    vehicle: int
    actuator: str
    stale: bool
    age_s: float


class AlertObject(_Event):
    """A text was sent to the ground station."""

    event: Literal["alert"] = "alert"
    vehicle: int
    severity: int
    text: str


class ActuatorStatus(Contract):
    """One actuator now.

    ``condition`` is ``undecided`` while ``stale``; ``held`` is the condition at the last data, and
    ``age_s`` their age, null before any.
    """

    vehicle: int | None
    actuator: str
    condition: Condition
    held: Condition
    worst: Condition
    stale: bool
    age_s: float | None
    rate_hz: float
    friction_nm: Interval | None
    network: str | None
    probability: float | None
    suspects: tuple[Suspect, ...]
    tier: str | None
    late: int
    reason: str | None


class LinkStatus(Contract):
    """What the links received, accepted and rejected.

    ``frames`` were accepted. ``missing_frames``, ``reordered_frames`` and ``duplicated_frames`` come from the
    sequence numbers of the senders; ``dropped_datagrams`` are those that this computer was too slow to
    fetch. ``contested`` are the vehicles as which more than one sender transmits now.
    """

    age_s: float | None
    frames_per_s: float
    bytes_per_s: float
    datagrams: int
    bytes: int
    frames: int
    unknown_frames: int
    bytes_skipped: int
    bad_crc_frames: int
    unsigned_frames: int
    bad_signatures: int
    replayed_frames: int
    missing_frames: int
    reordered_frames: int
    duplicated_frames: int
    dropped_datagrams: int
    contested: tuple[int, ...] = ()


class RecordStatus(Contract):
    """The recording; ``lost_frames`` could not be written, ``error`` says why while that lasts."""

    path: str
    bytes: int
    lost_frames: int
    error: str | None


class OutputStatus(Contract):
    """An output that is too slow: the number of dropped objects, and the error while it lasts."""

    name: str
    dropped: int
    error: str | None


class StatusObject(_Event):
    """Once a second: every actuator, the links, the recording, and outputs that dropped something."""

    event: Literal["status"] = "status"
    uptime_s: float
    actuators: tuple[ActuatorStatus, ...]
    link: LinkStatus
    record: RecordStatus | None
    outputs: tuple[OutputStatus, ...] = ()


class EndObject(_Event):
    """The session ended; the assessment is that of ``mavhums analyse``."""

    event: Literal["end"] = "end"
    link: LinkStatus
    record: RecordStatus | None
    outputs: tuple[OutputStatus, ...] = ()
    assessment: Assessment


LiveObject = Annotated[
    StartObject
    | AirframeObject
    | NoticeObject
    | WindowObject
    | ConditionObject
    | StaleObject
    | AlertObject
    | StatusObject
    | EndObject,
    Field(discriminator="event"),
]


def _generate_schema() -> dict[str, Any]:
    schema = TypeAdapter(LiveObject).json_schema(by_alias=True, mode="serialization")
    return published_schema(schema, "live-1")


if __name__ == "__main__":
    print(json.dumps(_generate_schema(), indent=2, ensure_ascii=False))
