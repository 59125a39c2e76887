"""What was left out of a log's samples, by message and reason."""

from __future__ import annotations

from collections import Counter

from mavhums.engine.axes import Axes
from mavhums.log.base.losses import Losses
from mavhums.vehicle.clocks import Clocks

__all__ = ["with_drops"]


def with_drops(losses: Losses, clocks: Clocks, axes: Axes) -> Losses:
    """Return the losses of a log with the samples that clocks and grids left out."""
    late, same, copies, broken = (Counter[str]() for _ in range(4))
    for (_, message), count in clocks.copies.items():
        copies[message] += count
    for (_, message), count in clocks.broken.items():
        broken[message] += count
    for vehicle in axes.vehicles():
        for message, received in axes.received(vehicle).items():
            late[message] += received.late
            same[message] += received.repeated
    found = {
        "late_samples": late,
        "same_time_samples": same,
        "broken_stamps": broken,
        "copies": copies,
    }
    return losses.model_copy(
        update={name: {key: n for key, n in sorted(counts.items()) if n} for name, counts in found.items()}
    )
