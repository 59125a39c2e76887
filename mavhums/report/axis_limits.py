"""The limits by which an axis is judged: a section of the airframe profile, and a part of the verdict."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from mavhums.core.models import Contract

__all__ = ["AxisLimits"]

_Share = Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)]
_Deviations = Annotated[float, Field(ge=3, le=1000, allow_inf_nan=False)]


class AxisLimits(Contract):
    """Limits of the axes: control effectiveness, lag, trim and tracking."""

    effectiveness_degraded: _Share = Field(
        default=0.8,
        description="Share of the reference's control effectiveness below which a certain loss is degraded. "
        "One of two equal surfaces that keeps 60 % of its effect leaves this share.",
    )
    effectiveness_emergency: _Share = Field(
        default=0.65,
        description="Share of the reference's control effectiveness up to which a certain loss is an "
        "emergency. One of two equal surfaces that no longer moves leaves 45 to 65 %, and the next failure "
        "may take the rest.",
    )
    lag_s: Annotated[float, Field(ge=0.1, le=5, allow_inf_nan=False)] = Field(
        default=0.3,
        description="Additional lag from which a servo is slow, s. It is the shortest that the test "
        "tells from the scatter of healthy flights, 0.1 s.",
    )
    trim_deviations: _Deviations = Field(
        default=6.5,
        description="Roll rate that no demand explains over three seconds, in standard deviations of the "
        "reference, from which a surface stands deflected. A quarter above the highest of healthy flights.",
    )
    trim_shift: _Share = Field(
        default=0.1,
        description="Change of the roll trim from the earlier flights, as a share of the full demand. "
        "Healthy flights of one aircraft scatter by 0.01 to 0.02.",
    )
    roll_tracking_deviations: _Deviations = Field(
        default=8.0,
        description="Distance of the roll angle from its demand, in standard deviations of the flight's "
        "beginning. A quarter above the highest value of healthy flights.",
    )
    pitch_tracking_deviations: _Deviations = Field(
        default=7.5,
        description="Distance of the pitch angle from its demand, in standard deviations of the flight's "
        "beginning. A quarter above the highest value of healthy flights.",
    )

    @model_validator(mode="after")
    def _ordered(self) -> AxisLimits:
        if self.effectiveness_emergency >= self.effectiveness_degraded:
            raise ValueError("effectiveness_emergency must lie below effectiveness_degraded")
        return self
