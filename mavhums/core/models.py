"""Base classes of the typed objects that mavhums reads from files and writes as JSON."""

from __future__ import annotations

from importlib import import_module

from pydantic import BaseModel, ConfigDict


class Frozen(BaseModel):
    """An immutable object that rejects unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)

    def to_json(self, *, indent: int | None = 2) -> str:
        """Return the object as JSON."""
        return self.model_dump_json(by_alias=True, indent=indent)


class Contract(Frozen):
    """An object of a published JSON schema: every number is finite, every field is written."""

    model_config = ConfigDict(allow_inf_nan=False, json_schema_serialization_defaults_required=True)


class Drawn(Contract):
    """A result that a notebook shows as a person reads it, not as its fields."""

    # Who asks the object itself asks for its words; what draws it lies in a room above, and loads only then.

    def summary(self) -> str:
        """Return what a command prints of it: what was found, since when, and what to do."""
        return str(import_module("mavhums.show.terminal").summary(self))

    def _repr_html_(self) -> str:
        return str(import_module("mavhums.show.html").cell(self))
