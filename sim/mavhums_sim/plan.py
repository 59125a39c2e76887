"""A campaign described in a TOML file: cyclograms × conditions × seeds."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from mavhums_sim.conditions import Condition
from mavhums_sim.ema import DataSheet, EmaParameters
from mavhums_sim.flight import Flight
from mavhums_sim.link import Link
from mavhums_sim.rates import Rates

Tier = Literal["instrumented", "esc-signed", "esc-info", "esc-unsigned", "named", "pwm"]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class PlannedCondition(_Strict):
    """One condition at one or several severities; ``fault = "none"`` is healthy.

    Attributes
    ----------
    severity
        Severity in the fault's unit.
    onset, at_s
        ``constant``, ``step`` at ``at_s``, or ``growing`` from ``at_s`` to the end.
    """

    fault: str
    severity: tuple[float, ...] = ()
    onset: Literal["constant", "step", "growing"] = "constant"
    at_s: float = 0.0

    @field_validator("severity", mode="before")
    @classmethod
    def _several(cls, value: object) -> object:
        return value if isinstance(value, list | tuple) else (value,)

    @model_validator(mode="after")
    def _complete(self) -> PlannedCondition:
        if self.fault != "none" and not self.severity:
            raise ValueError(f"{self.fault} needs a severity")
        if self.onset == "constant" and self.at_s:
            raise ValueError('at_s needs onset "step" or "growing"')
        return self

    def expand(self) -> Iterator[tuple[str, tuple[Condition, ...]]]:
        """Yield (name, conditions) for each severity."""
        if self.fault == "none":
            yield "healthy", ()
            return
        for severity in self.severity:
            start = 0.0 if self.onset == "growing" else severity
            onset = "" if self.onset == "constant" else f"-{self.onset}"
            yield f"{self.fault}-{severity:g}{onset}", (Condition(self.fault, start, severity, self.at_s),)


class Plan(_Strict):
    """The flights of a campaign: every combination of cyclogram, condition and seed once.

    Attributes
    ----------
    seed, seeds
        First seed, and number of flights of each combination.
    paired
        Whether all combinations share their seeds (the same pilot and gusts in every condition), or
        each flight has its own seed.
    model
        ``single-mass`` or ``two-mass``.
    individuals
        Whether each flight has individual actuators, or all use the data sheet's.
    surfaces
        Surfaces with the condition.
    tiers
        Telemetry tiers of the actuators; see :mod:`mavhums_sim.tiers`.
    data_sheet
        The type of actuator; Table 1 of the paper by default.
    rates, link
        As in :class:`~mavhums_sim.rates.Rates` and :class:`~mavhums_sim.link.Link`; the key in hexadecimal.
    """

    seed: int = Field(0, ge=0)
    seeds: int = Field(1, ge=1)
    paired: bool = False
    duration_s: float = 100.0
    rate_hz: float = 100.0
    model: Literal["single-mass", "two-mass"] = "single-mass"
    friction_method: Literal["impulse", "karnopp"] = "impulse"
    esc_side: Literal["motor", "bus"] = "motor"
    tiers: tuple[Tier, ...] = ("instrumented", "esc-unsigned", "pwm")
    individuals: bool = False
    cyclograms: tuple[str, ...] = ("takeoff",)
    surfaces: tuple[str, ...] = ("elevator",)
    conditions: tuple[PlannedCondition, ...]
    data_sheet: DataSheet = DataSheet()
    rates: Rates = Rates()
    link: Link = Link()

    @field_validator("data_sheet", "rates", "link", mode="before")
    @classmethod
    def _table(cls, value: Any, info: Any) -> object:
        kind = {"data_sheet": DataSheet, "rates": Rates, "link": Link}[info.field_name]
        if not isinstance(value, dict):
            return value
        if isinstance(value.get("key"), str):
            value = {**value, "key": bytes.fromhex(value["key"])}
        unknown = set(value) - set(kind.__dataclass_fields__)  # type: ignore[attr-defined]
        if unknown:
            raise ValueError(f"no such entry: {', '.join(sorted(unknown))}")
        return kind(**value)

    def parameters(self) -> EmaParameters:
        """Return the type of actuator."""
        ema = EmaParameters.from_data_sheet(self.data_sheet, friction_method=self.friction_method)
        return ema.two_masses() if self.model == "two-mass" else ema

    def flights(self) -> Iterator[tuple[str, Flight]]:
        """Yield (name, flight); names are unique."""
        template = Flight(
            duration_s=self.duration_s,
            rate_hz=self.rate_hz,
            parameters=self.parameters(),
            esc_side=self.esc_side,
            tiers=self.tiers,
            rates=self.rates,
        )
        combinations = [
            (f"{cyclogram}-{name}", cyclogram, condition)
            for cyclogram in self.cyclograms
            for planned in self.conditions
            for name, condition in planned.expand()
        ]
        for index, (name, cyclogram, condition) in enumerate(combinations):
            for k in range(self.seeds):
                seed = self.seed + k + (0 if self.paired else index * self.seeds)
                yield (
                    f"{name}-{seed:04d}",
                    replace(
                        template,
                        seed=seed,
                        cyclogram=cyclogram,
                        conditions=dict.fromkeys(self.surfaces, condition) if condition else {},
                        individuals=seed if self.individuals else None,
                    ),
                )


def load_plan(path: Path) -> Plan:
    """Read a campaign from a TOML file.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not TOML, describes a flight twice, or has an unknown or impossible entry.
    """
    try:
        plan = Plan.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
        names = Counter(name for name, _ in plan.flights())
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{path}: {where}: {first['msg'].removeprefix('Value error, ')}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    if not names:
        raise ValueError(f"{path}: it plans no flights")
    name, times = names.most_common(1)[0]
    if times > 1:
        raise ValueError(f"{path}: {name} would be flown {times} times")
    return plan
