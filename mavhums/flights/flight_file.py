"""A file of flights: a kept flight with its record, or what ``mavhums analyse --json`` prints."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import Field, ValidationError
from pydantic_core import from_json

from mavhums.core.errors import MavhumsError
from mavhums.core.models import Frozen
from mavhums.flights.history import PastFlight
from mavhums.results.assessment import READABLE, SCHEMA, Assessment
from mavhums.results.verdict import OwnRecord

FLIGHT_SCHEMA: Final = "mavhums.flight/1"
_FAMILIES: Final = tuple(each.split("/", maxsplit=1)[0] + "/" for each in (SCHEMA, FLIGHT_SCHEMA))
_LARGEST_FILE: Final = 256 << 20
_LARGEST_VALUE: Final = 1e12
_AGAIN: Final = "analyse its log again"


class _Record(Frozen):
    """What a flight leaves of an actuator for the comparison with its other flights."""

    vehicle: int
    actuator: str
    own: tuple[OwnRecord, ...]


class KeptFlight(Frozen):
    """A kept flight; a file of the version before has the record within the assessment."""

    schema_: Literal["mavhums.flight/1"] = Field(default="mavhums.flight/1", alias="schema")
    assessment: Assessment
    record: tuple[_Record, ...] = ()

    @classmethod
    def of(cls, assessment: Assessment) -> Self:
        """Return an assessment with its record apart."""
        records = (
            _Record(vehicle=verdict.vehicle or 0, actuator=verdict.actuator, own=verdict.own)
            for verdict in assessment.verdicts
            if verdict.own
        )
        return cls(assessment=assessment, record=tuple(records))

    def whole(self) -> Assessment:
        """Return the assessment with its record within it."""
        own = {(each.vehicle, each.actuator): each.own for each in self.record}
        verdicts = tuple(
            verdict.model_copy(update={"own": own.get((verdict.vehicle or 0, verdict.actuator), verdict.own)})
            for verdict in self.assessment.verdicts
        )
        return self.assessment.model_copy(update={"verdicts": verdicts})


class _ForeignFileError(MavhumsError):
    """A JSON file that is not a flight; it is left alone, without a loss."""


def read_flights(path: Path) -> Iterator[PastFlight | MavhumsError]:
    """Yield each assessment of a file, or the error in it."""
    try:
        written = path.stat().st_mtime
        items = _items(path)
    except OSError as error:
        yield MavhumsError(f"{path}: {reason_of(error)}", "make it readable, or take it out of the folder")
        return
    except MavhumsError as error:
        yield error
        return
    for where, item in items:
        try:
            kept = isinstance(item, dict) and item.get("schema") == FLIGHT_SCHEMA
            assessment = KeptFlight.model_validate(item).whole() if kept else Assessment.model_validate(item)
            _check_plausible(assessment, path)
            yield PastFlight.of(assessment, path, written)
        except ValidationError as error:
            mistake = error.errors(include_input=False, include_url=False)[0]
            place = ".".join(str(part) for part in (*where, *mistake["loc"]))
            yield MavhumsError(f"{path}: {place[:120]}: {mistake['msg'][:120]}", _AGAIN)
        except MavhumsError as error:
            yield error


def _items(path: Path) -> list[tuple[tuple[str | int, ...], Any]]:
    """Return the unvalidated assessments or kept flights in a file, each with its location in the JSON."""
    content = _json(path)
    schema = content.get("schema") if isinstance(content, dict) else None
    if not isinstance(schema, str) or not schema.startswith(_FAMILIES):
        raise _ForeignFileError(f"{path}: is not an assessment, and was left alone")
    if schema not in (FLIGHT_SCHEMA, *READABLE):
        expected = FLIGHT_SCHEMA if schema.startswith(_FAMILIES[1]) else SCHEMA
        raise MavhumsError(
            f"{path}: is of the schema {schema[:60]!r}, not {expected}", f"update mavhums, or {_AGAIN}"
        )
    several = content.get("assessments")
    if isinstance(several, list):
        return [(("assessments", place), item) for place, item in enumerate(several)]
    return [((), content)]


def _json(path: Path) -> Any:
    if not path.is_file() or path.stat().st_size > _LARGEST_FILE:
        raise MavhumsError(f"{path}: not a regular file of an assessment's size", "take it out of the folder")
    data = path.read_bytes()
    try:
        return from_json(data.decode(json.detect_encoding(data)), allow_inf_nan=False)
    except ValueError as error:
        problem = f"{path}: is not a complete JSON file: {str(error)[:100]}"
        raise MavhumsError(problem, f"if it was an assessment, {_AGAIN}; else take it out") from error


def _check_plausible(assessment: Assessment, path: Path) -> None:
    """Reject implausibly large numbers before they enter statistics."""
    for verdict in assessment.verdicts:
        for shown in verdict.indicators:
            value = shown.value
            numbers = (value.estimate, value.low, value.high, shown.scatter, shown.limit, shown.emergency)
            largest = max(abs(number) for number in (*numbers, shown.windows) if number is not None)
            if largest > _LARGEST_VALUE or not 0 <= (verdict.vehicle or 0) <= 255:
                raise MavhumsError(
                    f"{path}: {verdict.actuator[:60]}: contains values outside the accepted range", _AGAIN
                )


def reason_of(error: OSError) -> str:
    """Return why the system refused, in lower case."""
    return (error.strerror or str(error)).lower()
