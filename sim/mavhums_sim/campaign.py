"""Many flights with their ground truth: the paper's eight conditions, and one that grows."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path

from mavhums_sim.flight import Flight, fly
from mavhums_sim.telemetry import write_tlog

__all__ = ["CAMPAIGNS", "PAPER_FRICTION_NM", "paper_campaign", "run_campaign", "write_truth"]

PAPER_FRICTION_NM = (0.225, 0.275, 0.325, 0.375, 0.875, 0.925, 0.975, 1.025)
_SURFACE = "elevator"


def paper_campaign(seed: int = 0, duration_s: float = 100.0) -> Iterator[tuple[str, Flight]]:
    """Yield (name, flight): the elevator at each of the paper's frictions, and growing from 0.225 to 1.0 N·m.

    Every flight has a seed, and so a pilot and gusts, of its own.
    """
    for k, friction in enumerate(PAPER_FRICTION_NM):
        flight = Flight(
            seed=100 * seed + k, duration_s=duration_s, friction_nm={_SURFACE: (friction, friction)}
        )
        yield f"friction-{friction:.3f}", flight
    growing = Flight(
        seed=100 * seed + len(PAPER_FRICTION_NM), duration_s=duration_s, friction_nm={_SURFACE: (0.225, 1.0)}
    )
    yield "friction-growing", growing


CAMPAIGNS: dict[str, Callable[[int, float], Iterator[tuple[str, Flight]]]] = {"paper": paper_campaign}


def run_campaign(
    flights: list[tuple[str, Flight]],
    folder: Path,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Fly and log each flight into ``folder`` and return the path of its ``truth.json``.

    Parameters
    ----------
    flights
        (name, flight) pairs; each becomes ``NAME.tlog``.
    folder
        Created if it does not exist.
    progress
        Called with the flights flown and their number, after each.

    Raises
    ------
    OSError
        If the folder or a file in it cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    truths = []
    for done, (name, flight) in enumerate(flights, start=1):
        record = fly(flight)
        log = folder / f"{name}.tlog"
        counts = write_tlog(record, log)
        truths.append({"log": log.name, **record.truth(), "messages": counts})
        if progress:
            progress(done, len(flights))
    return write_truth(truths, folder / "truth.json")


def write_truth(flights: list[dict[str, object]], path: Path) -> Path:
    """Write ground truth as JSON, atomically, and return its path."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.write_text(json.dumps({"flights": flights}, indent=2) + "\n", encoding="utf-8")
        os.replace(partial, path)  # noqa: PTH105 - atomic, and says so
    finally:
        partial.unlink(missing_ok=True)
    return path
