"""The contract of what a network says beside the physics, and of who decides."""

from __future__ import annotations

from typing import Any, Literal, get_args

from pydantic import Field

from mavhums.core.conditions import Condition
from mavhums.core.models import Contract

__all__ = ["DECIDE", "Decide", "ModelSummary", "NetworkAnswer", "with_network"]

Decide = Literal["physics", "network", "both"]
"""Who decides an actuator's friction; with ``both`` the physics, and a network's disagreement is told."""
DECIDE: tuple[Decide, ...] = get_args(Decide)


class ModelSummary(Contract):
    """A network whose votes are among the evidence."""

    name: str
    hash: str


class NetworkAnswer(Contract):
    """What a network says of an actuator's flight, beside the physics or in its place.

    ``windows`` is the number of ten-second windows that it answered, ``first_emergency_s`` the middle of the
    first one in which it finds an emergency more likely than not, ``share_of_samples`` the share of the
    samples in motion within its training range that it calls an emergency, ``p_emergency`` its probability in
    the last window, and ``condition`` the gravest that twenty windows in a row agreed on. ``decides`` tells
    who decided the verdict: ``physics``, ``network``, or ``both``, where the physics decides and what the
    network says otherwise is told. A file of version 0.1 tells ``p_emergency`` alone.
    """

    model: ModelSummary
    inputs: tuple[str, ...] = ()
    windows: int | None = Field(default=None, ge=0)
    first_emergency_s: float | None = None
    share_of_samples: float | None = Field(default=None, ge=0, le=1)
    p_emergency: float | None = Field(default=None, ge=0, le=1)
    condition: Condition = "undecided"
    decides: Decide = "physics"


def with_network(data: Any) -> Any:
    """Return the data of a verdict; one of version 0.1 has its single number as the answer of a network.

    That number is the probability of an emergency in the last window.
    """
    if not isinstance(data, dict) or not {"p_emergency", "model"} & data.keys():
        return data
    kept = {key: value for key, value in data.items() if key not in ("p_emergency", "model")}
    if data.get("model") is not None and data.get("p_emergency") is not None:
        kept["network"] = {"model": data["model"], "p_emergency": data["p_emergency"]}
    return kept
