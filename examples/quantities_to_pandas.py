"""Load V1–V12 of a log's actuators into pandas, and plot command and angle.

    python examples/quantities_to_pandas.py flight.tlog quantities.png [AIRFRAME]

The plot needs matplotlib (pip install matplotlib); without it the table is all there is.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

import mavhums


def main(path: str, picture: str, airframe: str | None = None) -> pd.DataFrame:
    """Return one table of all actuators, indexed by actuator and time (UTC); plot it to a PNG."""
    histories = mavhums.actuators(mavhums.read_log(path), airframe)
    if not histories:
        raise mavhums.MavhumsError(f"{path}: contains no data of the actuators", f"mavhums inspect {path}")
    table = pd.concat({name: history.frame for name, history in histories.items()}, names=["actuator"])
    print(table.groupby("actuator")[["V1", "V3", "V5", "V7"]].agg(["min", "max"]).round(3).to_string())
    for name, history in histories.items():
        print(f"{name}: V1 from {history.provenance.get('V1')}, V3 from {history.provenance.get('V3')}")
    plot(table, Path(picture))
    return table


def plot(table: pd.DataFrame, picture: Path) -> None:
    """Draw the command V1 and the angle V3 of each actuator, one above the other."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        print("no picture: it needs matplotlib: pip install matplotlib")
        return
    names = list(table.index.unique("actuator"))
    figure = Figure(figsize=(10, 2.2 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), sharex=True, squeeze=False)[:, 0]
    for axis, name in zip(axes, names, strict=True):
        one = table.loc[name]
        seconds = (one.index - table.index.get_level_values("time").min()).total_seconds()
        axis.plot(seconds, one["V1"], label="V1, command", linewidth=0.8)
        axis.plot(seconds, one["V3"], label="V3, angle", linewidth=0.8)
        axis.set_ylabel(f"{name}, °")
    axes[0].legend(loc="upper right")
    axes[-1].set_xlabel("time, s")
    figure.savefig(picture)
    print(f"picture: {picture}")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: quantities_to_pandas.py LOG PICTURE.png [AIRFRAME]")
    try:
        main(*sys.argv[1:4])
    except mavhums.MavhumsError as error:
        sys.exit(str(error))
