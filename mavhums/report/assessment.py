"""The verdict's contract: the results for each actuator and each axis, as typed objects and as JSON.

The JSON schema is stored beside this module in ``schema/assessment-2.json`` and is generated
from these classes by ``python -m mavhums.report.assessment``.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from importlib import resources
from typing import TYPE_CHECKING, Any, Final, Literal

from pydantic import Field, model_validator

from mavhums.core.about import NOTICE
from mavhums.core.conditions import SEVERITY, URGENCY, Condition
from mavhums.core.errors import ExitCode
from mavhums.core.models import Contract
from mavhums.core.quantities import KEYS
from mavhums.log.base.losses import Losses
from mavhums.report.sections import (
    DECIDE,
    AxisLimits,
    Decide,
    FlightCopy,
    FlightIdentity,
    ModelSummary,
    NetworkAnswer,
    with_network,
)
from mavhums.report.standing import Interval, Standing
from mavhums.report.usage import VehicleUsage

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "ALL",
    "DECIDE",
    "NOTICE",
    "READABLE",
    "RECORD",
    "SCHEMA",
    "Assessment",
    "Candidate",
    "Coverage",
    "Decide",
    "Evidence",
    "Indicator",
    "Interval",
    "LogSummary",
    "ModelSummary",
    "NetworkAnswer",
    "OwnRecord",
    "Since",
    "Suspect",
    "Verdict",
    "exit_code_of",
    "json_schema",
    "without_record",
]

SCHEMA = "mavhums.assessment/2"
READABLE = ("mavhums.assessment/1", SCHEMA)
"""Versions whose objects are still read: version 2 adds fields; ``network`` replaces one number."""

RECORD: Final[dict[str, Any]] = {"verdicts": {"__all__": {"own"}}}
"""Fields that only a later comparison needs: in a kept flight's record, and not in the public JSON."""

MEASURED: Final[Mapping[str, str]] = {
    "rates": "body rates",
    "force": "acceleration",
    "speed": "airspeed",
}
"""Sources of an axis, beside the outputs' (V1), in the fields ``provenance``."""

ALL = "all"
"""Stands for the actuator where a verdict is on all of a vehicle's."""


class Suspect(Contract):
    """A fault that the evidence points at."""

    fault: str
    confidence: float = Field(ge=0, le=1)


class Candidate(Contract):
    """A surface that explains the finding about an axis, with its servo output.

    ``probability`` is None where nothing tells the candidates apart; ``because`` names what does.
    """

    surface: str
    servo: int
    probability: float | None = Field(default=None, ge=0, le=1)
    because: str | None = None


class Since(Contract):
    """When the actuator was first found in its present state."""

    flight_time_s: float
    utc: str


class Coverage(Contract):
    """How much of the flight could be judged: windows of 10 s, one each second.

    ``decidable`` counts those on which a condition can rest, because they show the friction or a fault.
    ``excluded`` counts, for an axis, the seconds over which a loss of 40 % or more is excluded with 95 %, and
    ``excluded_until_s`` is the flight second of the last one after the reference.
    ``late`` counts samples that came too late to be judged, ``implausible`` by quantity the values that no
    such actuator can have, which count as not measured.
    """

    moving_fraction: float = Field(ge=0, le=1)
    windows: int = Field(ge=0)
    decidable: int = Field(ge=0)
    excluded: int = Field(default=0, ge=0)
    excluded_until_s: float | None = None
    late: int = Field(default=0, ge=0)
    implausible: dict[str, int] = {}


class Evidence(Contract):
    """One finding, with the rule that made it one."""

    kind: str
    start_s: float
    end_s: float
    value: float
    limit: float | None = None
    rule: str


class Indicator(Contract):
    """A physical quantity that shows a fault, as the whole flight has it.

    Attributes
    ----------
    fault
        That it shows.
    quantity, unit
        What was estimated, for example ``Coulomb friction`` in ``N·m``.
    value
        Over the whole flight.
    windows, scatter
        Number of decidable windows that do not overlap, and the standard deviation of their estimates;
        None of fewer than two.
    limit
        Value from which the actuator is degraded; None where only its own baseline can tell.
    emergency
        Value from which it is an emergency; None where the fault alone is none. A fault grows upwards.
    baseline
        What the actuator's own history says it is, as a 95 % prediction interval of one flight.
    baseline_flights, needed_flights
        How many flights that baseline rests on, and how many it takes; None where limits alone decide.
    least_rise
        Share of the baseline by which the quantity must rise to be found with 95 % probability.
    load
        Mean size of the load in the flight's motion, in the quantity's unit; None where the friction does not
        depend on it, or nothing shows it.
    """

    fault: str
    quantity: str
    unit: str
    value: Interval
    windows: int = Field(ge=1)
    scatter: float | None = Field(default=None, ge=0)
    limit: float | None = None
    emergency: float | None = None
    baseline: Interval | None = None
    baseline_flights: int | None = Field(default=None, ge=0)
    needed_flights: int | None = Field(default=None, ge=1)
    least_rise: float | None = Field(default=None, ge=0)
    load: float | None = Field(default=None, ge=0)


class OwnRecord(Contract):
    """What a flight leaves of one own-scale equation, for the comparison with the actuator's other flights.

    Attributes
    ----------
    equation
        That the sums belong to.
    setup
        How it was measured, in words; flights that were measured in another way are not compared.
    rate_hz, duration_s
        Of the samples, and the time that they cover.
    temperature_c
        Median over the flight; None where the log carries none.
    peak_a, peak_v
        Current and voltage of the motor that 99.9 % of the samples do not exceed, without sign, and the
        current's 95 % interval; None of other equations than the voltage's.
    supply_v
        Voltage of the supply, as the profile has it; None where it has none.
    groups
        Sums over parts of the flight: the number of samples, and the upper triangle of the sums of products
        of the equation's columns, the left side last.
    """

    equation: str
    setup: str
    rate_hz: float = Field(gt=0)
    duration_s: float = Field(gt=0)
    temperature_c: float | None = None
    peak_a: Interval | None = None
    peak_v: float | None = Field(default=None, ge=0)
    supply_v: float | None = Field(default=None, gt=0)
    groups: tuple[tuple[float, ...], ...]


class Verdict(Contract):
    """What the log says of one actuator, of one axis of the aircraft, or of one motor of a multirotor.

    ``subject`` tells which; ``actuator`` is its name, for an axis ``roll``, ``pitch`` or ``yaw``, and
    ``surfaces`` are those that move it; for a motor ``motor 1`` and so on, in the autopilot's order.
    ``effectiveness`` is the share of its reference, or of its thrust, that it keeps now,
    and ``limits`` are those by which it was judged.
    ``condition`` is the last decidable state, ``worst`` the worst one reached. ``normal``, ``degraded`` and
    ``emergency`` rest on a known limit; without one, ``unchanged``, ``changed`` and ``learning`` compare the
    actuator with its own flights before. ``undecided`` always carries ``reason`` and ``remedy``;
    ``advice`` is the recommended action, which files of earlier versions lack. ``network``
    is what a network says of its friction; None if none covers the log.

    Of an axis with a finding, ``candidates`` are the surfaces that explain it, the likeliest one first, and
    ``consequence_of`` is the axis whose finding explains this one: one fault is one finding.

    Examples
    --------
    >>> Verdict(vehicle=1, actuator="elevator", condition="normal", worst="degraded").gravest
    'degraded'
    """

    subject: Literal["actuator", "axis", "motor"] = "actuator"
    vehicle: int | None
    actuator: str
    surfaces: tuple[str, ...] = ()
    candidates: tuple[Candidate, ...] = ()
    consequence_of: str | None = None
    condition: Condition
    worst: Condition
    effectiveness: Interval | None = None
    limits: AxisLimits | None = None
    network: NetworkAnswer | None = None
    friction_nm: Interval | None = None
    suspects: tuple[Suspect, ...] = ()
    since: Since | None = None
    coverage: Coverage = Coverage(moving_fraction=0, windows=0, decidable=0)
    tier: str | None = None
    provenance: dict[str, str] = {}
    evidence: tuple[Evidence, ...] = ()
    indicators: tuple[Indicator, ...] = ()
    own: tuple[OwnRecord, ...] = ()
    reason: str | None = None
    remedy: str | None = None
    advice: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _of_one_number(cls, data: Any) -> Any:
        return with_network(data)

    @property
    def gravest(self) -> Condition:
        """What the maintainer must act on: a fault that was seen, else that nothing is known, else normal."""
        return max(self.worst, self.condition, key=URGENCY.__getitem__)


class LogSummary(Contract):
    """The log that was judged.

    ``format`` is ``tlog``, ``dataflash`` or ``ulog``; ``flight`` says of each vehicle which flight it was,
    ``copies`` which other logs of the history are of the same flight; one of them counts. ``notices`` say
    what could not be checked.
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


class Assessment(Contract):
    """Every verdict that a log supports.

    ``model`` is the richest network among those of the verdicts, ``usage`` what each vehicle's log tells of
    the use of its servos. ``standings`` is how each actuator and axis stands over its flights, this one
    included, where there is a history; worst first.

    Examples
    --------
    >>> import mavhums
    >>> assessment = mavhums.analyse("flight.tlog")
    >>> print(assessment.summary().splitlines()[0][:19])
    elevator: emergency
    >>> assessment.exit_code.name
    'EMERGENCY'
    """

    schema_: Literal["mavhums.assessment/1", "mavhums.assessment/2"] = Field(
        default="mavhums.assessment/2", alias="schema"
    )
    notice: str = NOTICE
    log: LogSummary
    airframe: str | None
    model: ModelSummary | None
    verdicts: tuple[Verdict, ...]
    usage: tuple[VehicleUsage, ...] = ()
    standings: tuple[Standing, ...] = ()

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

    def summary(self) -> str:
        """Return one line per actuator, in descending order of severity."""
        lines = [_line(verdict) for verdict in self.ranked()]
        return "\n".join(lines)

    def ranked(self) -> list[Verdict]:
        """Return the verdicts in descending order of severity."""
        return sorted(self.verdicts, key=lambda verdict: -URGENCY[verdict.gravest])

    @property
    def exit_code(self) -> ExitCode:
        """The exit code for the worst condition.

        Unmonitored actuators do not count, unless no actuator was judged. What stands over the flights
        counts, too, and certain growth is degraded.
        """
        found = [verdict.gravest for verdict in self.verdicts]
        found += [one.condition for one in self.standings if SEVERITY[one.condition] > 0]
        if any(one.growth for one in self.standings):
            found.append("degraded")
        code = exit_code_of(found)
        return ExitCode.READ_WITH_LOSSES if code == ExitCode.OK and self.log.losses.any else code


def exit_code_of(found: Iterable[Condition]) -> ExitCode:
    """Return the exit code for the worst of these conditions; unmonitored actuators do not count.

    Examples
    --------
    >>> exit_code_of(["normal", "changed", "unmonitored"]).name, exit_code_of(["unmonitored"]).name
    ('DEGRADED', 'UNDECIDED')
    """
    several = [*found]
    counted = [condition for condition in several if condition != "unmonitored"]
    if several and not counted:
        return ExitCode.UNDECIDED
    gravest: Condition = max(counted, key=URGENCY.__getitem__, default="normal")
    return ExitCode.OK if gravest in ("normal", "unchanged") else _EXIT_CODES[gravest]


_EXIT_CODES: dict[Condition, ExitCode] = {
    "learning": ExitCode.UNDECIDED,
    "undecided": ExitCode.UNDECIDED,
    "changed": ExitCode.DEGRADED,
    "degraded": ExitCode.DEGRADED,
    "emergency": ExitCode.EMERGENCY,
}


def _line(verdict: Verdict) -> str:
    text = f"{verdict.actuator}: {verdict.condition}"
    if verdict.worst != verdict.condition:
        text += f" (worst {verdict.worst})"
    if verdict.effectiveness:
        kept = "thrust" if verdict.subject == "motor" else "control effectiveness"
        text += f", {kept} {100 * verdict.effectiveness.estimate:.0f} %"
    if verdict.friction_nm:
        text += f", friction {verdict.friction_nm.estimate:.3f} N·m"
    if verdict.since:
        text += f", since {verdict.since.flight_time_s:.1f} s"
    if verdict.reason:
        text += f": {'; '.join(filter(None, (verdict.reason, verdict.remedy)))}"
    return text


def json_schema() -> dict[str, Any]:
    """Return the versioned JSON schema of an assessment."""
    text = resources.files("mavhums.report").joinpath("schema/assessment-2.json").read_text(encoding="utf-8")
    schema: dict[str, Any] = json.loads(text)
    return schema


def without_record(definitions: dict[str, Any]) -> None:
    """Take the fields of :data:`RECORD` out of the definitions of a schema."""
    verdict = definitions["Verdict"]
    del verdict["properties"]["own"], definitions["OwnRecord"]
    verdict["required"] = [name for name in verdict.get("required", ()) if name != "own"]


def _generate_schema() -> dict[str, Any]:
    schema = Assessment.model_json_schema(by_alias=True, mode="serialization")
    for part in (schema, *schema["$defs"].values()):
        if "description" in part:
            part["description"] = part["description"].split("\n\nExamples")[0]
    without_record(schema["$defs"])
    provenance = schema["$defs"]["Verdict"]["properties"]["provenance"]
    provenance["propertyNames"] = {"enum": [*KEYS, *MEASURED]}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": SCHEMA, **schema}


if __name__ == "__main__":
    print(json.dumps(_generate_schema(), indent=2, ensure_ascii=False))
