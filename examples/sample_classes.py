"""The class of each sample over a flight, as the paper's figures 16 to 19 show it.

    python examples/sample_classes.py PICTURE TABLE.csv...

draws what ``mavhums export --classify`` wrote: for each actuator the class of each sample and, where the
model has a network of windows, that of each ten seconds. Without a table it flies four simulated flights and
draws the elevator's samples, a column for each packaged model. It needs the extra ``train`` (matplotlib).
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from mavhums.app.export import export_quantities
from mavhums.learn.precedents import LABELS
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


def main(picture: Path, tables: Sequence[Path] = ()) -> None:
    """Draw the picture of tables, or of simulated flights."""
    with tempfile.TemporaryDirectory() as folder:
        panels = own(tables) if tables else [*simulated(Path(folder))]
    figure = Figure(figsize=(13, 2.4 * len(panels)), layout="constrained")
    axes = figure.subplots(len(panels), max(map(len, panels)), sharex=True, squeeze=False)
    for row, mine in zip(axes, panels, strict=True):
        for plot, (title, classes, names) in zip(row, mine, strict=False):
            plot.plot(classes.index, classes.map(names.index), lw=0.3, marker=",", color="#0b66a8")
            plot.set_title(title, fontsize=8)
            plot.set_yticks(range(len(names)), names, fontsize=7)
    for plot in axes[-1]:
        plot.set_xlabel("flight time, s")
    figure.savefig(picture, dpi=100)


Panel = tuple[str, "pd.Series[str]", Sequence[str]]
"""A title, the classes by flight time, and the names of all classes from below."""


def own(tables: Sequence[Path]) -> list[list[Panel]]:
    """Return the samples and the windows of each actuator of exported tables."""
    panels = []
    for table in tables:
        windows = table.with_name(f"{table.stem}-windows.csv")
        names, of_windows = [], None
        if windows.exists():
            of_windows = pd.read_csv(windows).set_index("end_s")
            names = [name for name in (*LABELS, "abstained", "outside") if name in {*of_windows["class"]}]
        for actuator, frame in pd.read_csv(table).groupby("actuator"):
            row = [samples(frame, f"{table.stem}, {actuator}")]
            if of_windows is not None:
                classes = of_windows.loc[of_windows["actuator"] == actuator, "class"]
                row.append((f"{table.stem}, {actuator}: windows", classes, names))
            panels.append(row)
    return panels


def simulated(folder: Path) -> Iterator[list[Panel]]:
    """Yield for each friction the elevator's samples by each packaged model."""
    for title, log in flown(folder):
        frames = [(model, classified(log, model, folder / "classified.csv")) for model in MODELS]
        yield [samples(frame, f"{title}\n{model}") for model, frame in frames]


def samples(frame: pd.DataFrame, title: str) -> Panel:
    """Return the classes of samples within what the network has seen, and print the share of emergencies."""
    inside = frame[frame["inside"] & np.isfinite(frame["p_emergency"])]
    emergency, moves = inside["class"] == "emergency", inside["V7"].abs() > MOVING_REV_MIN
    share = 100 * emergency[moves].mean()
    print(
        f"{title.replace(chr(10), '; ')}: {share:.1f} % of the samples in motion, "
        f"{100 * emergency.mean():.1f} % of all are an emergency"
    )
    classes = inside.set_index("flight_time_s")["class"]
    return f"{title}: {share:.1f} % in motion an emergency", classes, ("normal", "emergency")


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
    elevator: pd.DataFrame = frame[frame["actuator"] == SURFACE]
    return elevator


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: sample_classes.py PICTURE [TABLE.csv...]")
    main(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]])
