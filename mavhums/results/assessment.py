"""The contracts of one log: its assessment with every verdict, and the inspection of what it contains.

The JSON schema of an assessment is stored beside this module in ``schema/assessment-2.json`` and is generated
from these classes by ``python -m mavhums.results.assessment``.
"""

from __future__ import annotations

import json
from importlib import resources
from typing import TYPE_CHECKING, Any, Final, Literal

from pydantic import Field

from mavhums.core.about import NOTICE, REPOSITORY
from mavhums.core.conditions import SEVERITY, URGENCY
from mavhums.core.errors import ExitCode
from mavhums.core.models import Contract, Drawn, Frozen
from mavhums.core.quantities import KEYS
from mavhums.log.base.decoder import Losses
from mavhums.results.sections import FlightCopy, FlightEvent, FlightIdentity, ModelSummary, VehicleUsage
from mavhums.results.standing import Standing, exit_code_of
from mavhums.results.verdict import MEASURED, Verdict

if TYPE_CHECKING:
    import pandas as pd

SCHEMA = "mavhums.assessment/2"

RECORD: Final[dict[str, Any]] = {"verdicts": {"__all__": {"own"}}}
"""Fields that only a later comparison needs: in a kept flight's record, and not in the public JSON."""


class LogSummary(Contract):
    """The log that was judged.

    ``format`` is ``tlog``, ``dataflash`` or ``ulog``; ``flight`` identifies the flight of each vehicle,
    ``copies`` are the other logs of the store that record the same flight; one of them counts. ``notices``
    list what could not be checked.
    """

    path: str | None
    sha256: str | None
    start_utc: str | None
    duration_s: float
    vehicles: tuple[int, ...]
    losses: Losses
    format: str = "tlog"
    flight: tuple[FlightIdentity, ...] = ()
    copies: tuple[FlightCopy, ...] = ()
    notices: tuple[str, ...] = ()


class Assessment(Drawn):
    """Every verdict that a log supports.

    ``model`` is the richest network among those of the verdicts, ``usage`` the usage of each
    vehicle's servos. ``standings`` is the state of each actuator and axis over its flights, including this
    one, where there is a store; worst first. ``earlier_flights`` is the number of flights of the aircraft
    that it was compared with; None without a store. ``events`` lists what happened in the flight, in order of
    time, ``events_left_out`` counts those that the list does not keep, as too many of one kind came.

    Examples
    --------
    >>> import mavhums
    >>> assessment = mavhums.analyse("flight.tlog")
    >>> "EMERGENCY: elevator" in assessment.summary()
    True
    >>> assessment.exit_code.name
    'EMERGENCY'
    """

    schema_: Literal["mavhums.assessment/2"] = Field(default="mavhums.assessment/2", alias="schema")
    notice: str = NOTICE
    log: LogSummary
    airframe: str | None
    model: ModelSummary | None
    verdicts: tuple[Verdict, ...]
    usage: tuple[VehicleUsage, ...] = ()
    standings: tuple[Standing, ...] = ()
    earlier_flights: int | None = None
    events: tuple[FlightEvent, ...] = ()
    events_left_out: int = Field(default=0, ge=0)

    def with_notice(self, notice: str) -> Assessment:
        """Return the assessment with one more notice on its log."""
        log = self.log.model_copy(update={"notices": (*self.log.notices, notice)})
        return self.model_copy(update={"log": log})

    def to_json(self, *, indent: int | None = 2) -> str:
        """Return the assessment as JSON that follows ``schema/assessment-2.json``."""
        return self.model_dump_json(by_alias=True, indent=indent, exclude=RECORD)

    def to_frame(self) -> pd.DataFrame:
        """Return one row per verdict, with the friction interval in columns of its own."""
        import pandas as pd

        rows = []
        for verdict in self.verdicts:
            row = verdict.model_dump(include={"subject", "vehicle", "actuator", "condition", "worst"})
            friction, network = verdict.friction_nm, verdict.network
            row |= {
                "network": network.condition if network else None,
                "network_first_emergency_s": network.first_emergency_s if network else None,
                "network_share_of_samples": network.share_of_samples if network else None,
                "effectiveness": verdict.effectiveness.estimate if verdict.effectiveness else None,
                "friction_nm": friction.estimate if friction else None,
                "friction_low_nm": friction.low if friction else None,
                "friction_high_nm": friction.high if friction else None,
                "since_s": verdict.since.flight_time_s if verdict.since else None,
                "moving_fraction": verdict.coverage.moving_fraction,
                "reason": verdict.reason,
            }
            rows.append(row)
        return pd.DataFrame(rows)

    def ranked(self) -> list[Verdict]:
        """Return the verdicts in descending order of severity."""
        return sorted(self.verdicts, key=lambda verdict: -URGENCY[verdict.gravest])

    @property
    def exit_code(self) -> ExitCode:
        """The exit code for the worst condition.

        Unmonitored actuators do not count, unless no actuator was judged. The states over the flights
        count, too, and certain growth is degraded.
        """
        found = [verdict.gravest for verdict in self.verdicts]
        found += [one.condition for one in self.standings if SEVERITY[one.condition] > 0]
        if any(one.growth for one in self.standings):
            found.append("degraded")
        code = exit_code_of(found)
        return ExitCode.READ_WITH_LOSSES if code == ExitCode.OK and self.log.losses.any else code


class MessageRate(Frozen):
    """How often one sender sent one message."""

    system: int
    component: int
    name: str
    count: int
    rate_hz: float


class NamedRate(Frozen):
    """How often one vehicle sent one named value, and in which message."""

    system: int
    message: str
    name: str
    count: int
    rate_hz: float


class VehicleTelemetry(Frozen):
    """What a vehicle reports of itself, and the best telemetry of its actuators.

    Without a profile, which lists the actuators, the ``tier`` is that of the log.
    """

    vehicle: int
    kind: str | None = None
    autopilot: str | None = None
    firmware: str | None = None
    board: str | None = None
    airframe: str | None
    tier: str | None
    gives: str


class Inspection(Frozen):
    """Contents of a log, with the assessment by which it is known what can be judged, and what is missing.

    The assessment has the verdicts on the axes, too, where another leaves them out: where none can be judged
    and actuators report by themselves. ``named`` lists named values, a thousand of them at most.
    """

    assessment: Assessment
    size_bytes: int
    vehicles: tuple[VehicleTelemetry, ...]
    messages: tuple[MessageRate, ...]
    named: tuple[NamedRate, ...] = ()
    unknown_ids: dict[int, int]

    def to_json(self, *, indent: int | None = 2) -> str:
        """Return the inspection as JSON, its assessment as that of ``mavhums analyse``."""
        return self.model_dump_json(by_alias=True, indent=indent, exclude={"assessment": RECORD})


def json_schema(name: str = "assessment-2") -> dict[str, Any]:
    """Return a versioned JSON schema: that of an assessment, or ``live-1`` of `mavhums live --json`."""
    text = resources.files("mavhums.results").joinpath(f"schema/{name}.json").read_text(encoding="utf-8")
    schema: dict[str, Any] = json.loads(text)
    return schema


def without_record(definitions: dict[str, Any]) -> None:
    """Take the fields of :data:`RECORD` out of the definitions of a schema."""
    verdict = definitions["Verdict"]
    del verdict["properties"]["own"], definitions["OwnRecord"]
    verdict["required"] = [name for name in verdict.get("required", ()) if name != "own"]


def published_schema(schema: dict[str, Any], name: str) -> dict[str, Any]:
    """Return a generated schema as it is published: without records, and without the examples in Python."""
    without_record(schema["$defs"])
    for part in (schema, *schema["$defs"].values()):
        if "description" in part:
            part["description"] = part["description"].split("\n\nExamples")[0]
    address = f"{REPOSITORY}/raw/main/mavhums/results/schema/{name}.json"
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": address, **schema}


def _generate_schema() -> dict[str, Any]:
    schema = published_schema(
        Assessment.model_json_schema(by_alias=True, mode="serialization"), "assessment-2"
    )
    provenance = schema["$defs"]["Verdict"]["properties"]["provenance"]
    provenance["propertyNames"] = {"enum": [*KEYS, *MEASURED]}
    return schema


if __name__ == "__main__":
    print(json.dumps(_generate_schema(), indent=2, ensure_ascii=False))
