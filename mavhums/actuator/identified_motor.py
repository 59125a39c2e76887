"""What a profile holds of a motor that was identified from its own flights."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["IdentifiedMotor"]

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class IdentifiedMotor(BaseModel):
    """What ``mavhums profile identify`` found of an actuator's motor; each with its 95 % interval.

    Attributes
    ----------
    resistance, back_emf, drop
        Estimate, low and high: of the winding, Ω; per rad/s of the rotor, V; of brushes or dead time, V.
    convention
        Of current and voltage. Only ``dc`` makes the back-EMF constant the torque constant.
    flights
        Logs that it rests on.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    resistance: tuple[_Positive, _Positive, _Positive]
    back_emf: tuple[_Positive, _Positive, _Positive]
    drop: tuple[_Finite, _Finite, _Finite]
    convention: Literal["unknown", "dc"] = "unknown"
    flights: tuple[str, ...]
