"""The constants of a motor identified from the actuator's own flights, as part of a profile."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["IdentifiedMotor"]

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class IdentifiedMotor(BaseModel):
    """Motor constants from ``mavhums profile identify``, each with its 95 % interval.

    Attributes
    ----------
    resistance, back_emf, drop
        Estimate, low and high: of the winding, Ω; per rad/s of the rotor, V; of brushes or dead time, V.
    friction_of_stall, torque_of_stall
        Friction and highest sustained torque as shares of the torque at stall; None if the logs and the
        profile do not tell them.
    convention
        Convention of current and voltage. The back-EMF constant equals the torque constant only for ``dc``.
    flights
        Logs that were used.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    resistance: tuple[_Positive, _Positive, _Positive]
    back_emf: tuple[_Positive, _Positive, _Positive]
    drop: tuple[_Finite, _Finite, _Finite]
    friction_of_stall: tuple[_Finite, _Finite, _Finite] | None = None
    torque_of_stall: tuple[_Finite, _Finite, _Finite] | None = None
    convention: Literal["unknown", "dc"] = "unknown"
    flights: tuple[str, ...]
