"""The class of each sample over a flight, as the paper's figures 16 to 19 show it.

    python examples/sample_classes.py docs/sample-classes.png

flies four simulated flights, exports each with ``mavhums export --classify``, and draws the class of each
sample of the elevator: healthy, at the limit of normal, at the limit of an emergency, and beyond it. With
logs after the picture's name, it draws these instead. It needs the extra ``train`` (matplotlib).
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from mavhums.app.export import export_quantities
from mavhums_sim import Flight, fly, write_tlog

FRICTION_NM = {
    "healthy, 0.225 N·m": 0.225,
    "the limit of normal, 0.375 N·m": 0.375,
    "the limit of an emergency, 0.875 N·m": 0.875,
    "emergency, 1.025 N·m": 1.025,
}
MODELS = ("paper-instrumented", "paper-without-load", "paper-esc")
SURFACE, SEED = "elevator", 3
MOVING_REV_MIN = 50.0
"""Rotor speed from which a sample shows friction: the profile's 1 °/s at the surface, times the gear."""


def main(picture: Path, logs: Sequence[Path] = ()) -> None:
    """Draw the picture: a row for each flight, a column for each packaged model."""
    with tempfile.TemporaryDirectory() as folder:
        flights = {log.name: log for log in logs} or dict(flown(Path(folder)))
        figure = Figure(figsize=(13, 2.4 * len(flights)), layout="constrained")
        axes = figure.subplots(len(flights), len(MODELS), sharex=True, sharey=True, squeeze=False)
        for row, (title, log) in zip(axes, flights.items(), strict=True):
            for plot, model in zip(row, MODELS, strict=True):
                table = classified(log, model, Path(folder) / "classified.csv")
                emergency, moves = table["class"] == "emergency", table["V7"].abs() > MOVING_REV_MIN
                told = table["inside"]
                plot.plot(table["flight_time_s"][told], 1 + emergency[told], lw=0.3, color="#0b66a8")
                share = 100 * emergency[told & moves].mean()
                plot.set_title(f"{title}\n{model}: {share:.1f} % in motion an emergency", fontsize=8)
                plot.set_yticks([1, 2], ["1 normal", "2 emergency"], fontsize=7)
                print(
                    f"{title}; {model}: {share:.1f} % of the samples in motion, "
                    f"{100 * emergency[told].mean():.1f} % of all are an emergency"
                )
        for plot in axes[-1]:
            plot.set_xlabel("flight time, s")
        figure.savefig(picture, dpi=100)


def flown(folder: Path) -> list[tuple[str, Path]]:
    """Fly each friction once and return the logs."""
    logs = []
    for title, friction in FRICTION_NM.items():
        log = folder / f"{friction}.tlog"
        write_tlog(fly(Flight(seed=SEED, friction_nm={SURFACE: (friction, friction)})), log)
        logs.append((title, log))
    return logs


def classified(log: Path, model: str, table: Path) -> pd.DataFrame:
    """Return the surface's classified samples, through the file that ``mavhums export`` writes."""
    export_quantities(log, table, classify=True, model=model)
    frame = pd.read_csv(table)
    own: pd.DataFrame = frame[(frame["actuator"] == SURFACE) & np.isfinite(frame["p_emergency"])]
    return own


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: sample_classes.py PICTURE [LOG...]")
    main(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]])
