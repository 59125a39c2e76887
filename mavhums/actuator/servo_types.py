"""Types of servos, whose constants a profile of many actuators need not repeat.

A ``servo_type`` is merged into the profile before it is validated. The packaged types are in
``servo_types.toml``; a profile adds its own as ``[servo_types.NAME]``, in the same form, as ``mavhums profile
identify --servo-type NAME`` writes them. What the profile says of an actuator itself comes first. A type
carries no limits and no voltage of the supply: these belong to the aircraft.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any, Final

from pydantic_core import PydanticCustomError

from mavhums.actuator.profile_checks import nearest

_LOADED_SHARE: Final = 0.5  # of the speed without load: that of a motor at half of its torque at stall
_OF_THE_SHEET: Final = ("source", "voltage", "stall_torque", "no_load_deg_s")


@cache
def packaged_servo_types() -> Mapping[str, Mapping[str, Any]]:
    """Return the packaged servo types by name, as their file has them.

    Examples
    --------
    >>> packaged_servo_types()["dynamixel-mx64"]["stall_torque"]
    6.0
    """
    text = resources.files("mavhums.actuator").joinpath("servo_types.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def with_servo_types(profile: Any) -> Any:
    """Return a profile's table with the values of its actuators' ``servo_type``, and without own types.

    Raises
    ------
    PydanticCustomError
        If there is no such type.
    """
    if not (isinstance(profile, dict) and isinstance(profile.get("actuators"), list)):
        return profile
    profile = {**profile}
    known = {**packaged_servo_types(), **profile.pop("servo_types", {})}
    profile["actuators"] = [_merged(own, known, k) for k, own in enumerate(profile["actuators"])]
    return profile


def _merged(own: Any, known: Mapping[str, Mapping[str, Any]], place: int) -> Any:
    name = own.get("servo_type") if isinstance(own, dict) else None
    if not isinstance(name, str):
        return own
    if name not in known:
        mistake = {"problem": f"no servo type {name!r}", "remedy": nearest(name, known)}
        context = {**mistake, "place": ("actuators", place, "servo_type")}
        raise PydanticCustomError("mapping", "{problem}", context)
    of_type = {key: value for key, value in known[name].items() if key not in _OF_THE_SHEET}
    if "no_load_deg_s" in known[name]:
        of_type["slew_deg_s"] = _LOADED_SHARE * known[name]["no_load_deg_s"]
    if "pwm_us" in own:
        of_type.pop("travel_deg", None)  # an angle belongs to its pulse
    ema = {**of_type.pop("ema", {}), **own.get("ema", {})}
    # A sheet without inertia makes no section that the user did not begin.
    return {**of_type, **own, **({"ema": ema} if "inertia" in ema or "ema" in own else {})}
