"""What a telemetry tier is; each is described beside its source in :mod:`mavhums.actuator.sources`."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Tier"]


@dataclass(frozen=True, slots=True)
class Tier:
    """One way in which a log carries actuator telemetry.

    Attributes
    ----------
    gives
        Which quantities it gives.
    judged
        Whether health can be judged from it.
    from_esc
        Whether the messages are those of any ESC, which on most aircraft drives a propeller.
    """

    name: str
    gives: str
    judged: bool = True
    from_esc: bool = False
