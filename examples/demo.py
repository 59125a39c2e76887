"""The complete data flow: simulate, log, judge, record, and compare the verdicts with the truth.

    python examples/demo.py demo

flies the paper's eight conditions and one flight in which the elevator's friction grows, and
leaves the logs, truth.json, verdicts.json and flight.rrd in the folder.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from mavhums import Assessment, MavhumsError, Verdict, analyse
from mavhums.show.terminal import render
from mavhums.show.viewer import viewer_command
from mavhums_sim.campaign import paper_campaign, run_campaign

SHOWN = "friction-growing"


def main(folder: Path) -> int:
    """Run the demonstration in ``folder`` and return 1 if a verdict is wrong."""
    console = Console()
    flights = list(paper_campaign())
    with Progress(console=Console(stderr=True), transient=True) as bar:
        flying = bar.add_task("simulating flights", total=len(flights))

        def show(done: int, _: int) -> None:
            bar.update(flying, completed=done)

        truth_file = run_campaign(flights, folder, show, workers=os.cpu_count() or 1)
        judging = bar.add_task("judging logs", total=len(flights))
        assessments: dict[str, Assessment] = {}
        for name, _ in flights:
            recording = folder / "flight.rrd" if name == SHOWN else None
            assessments[name] = analyse(folder / f"{name}.tlog", recording=recording)
            bar.advance(judging)
    truth = {entry["log"]: entry for entry in json.loads(truth_file.read_text())["flights"]}
    _write(folder / "verdicts.json", assessments)

    table, wrong = _compare(assessments, truth)
    console.print(table)
    console.print(f"\nThe flight in which friction grows, {folder}/{SHOWN}.tlog:\n", highlight=False)
    render(assessments[SHOWN], console)
    console.print(f"\n{wrong} of {sum(len(a.verdicts) for a in assessments.values())} verdicts are wrong.")
    console.print(f"Logs, truth.json, verdicts.json and flight.rrd are in {folder}/.", highlight=False)
    console.print(
        f"Open the recording with:  {viewer_command()} {folder}/flight.rrd", highlight=False, soft_wrap=True
    )
    return int(wrong > 0)


def _compare(assessments: dict[str, Assessment], truth: dict[str, dict[str, object]]) -> tuple[Table, int]:
    table = Table(
        title="The elevator's verdicts against the truth",
        title_justify="left",
        box=None,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    table.add_column("flight", no_wrap=True)
    table.add_column("true T_c, N·m", no_wrap=True)
    table.add_column("estimate, 95 %", no_wrap=True)
    table.add_column("network", justify="right")
    table.add_column("verdict")
    table.add_column("")
    wrong = 0
    for name, assessment in assessments.items():
        for verdict in assessment.verdicts:
            start, end = _friction(truth[f"{name}.tlog"], verdict.actuator)
            right = (verdict.condition, verdict.worst) == (_class(end), _class(max(start, end)))
            wrong += not right
            if verdict.actuator == "elevator":
                table.add_row(*_row(name, verdict, start, end), "right" if right else "WRONG")
    return table, wrong


def _row(name: str, verdict: Verdict, start: float, end: float) -> list[str]:
    friction, network = verdict.friction_nm, verdict.network
    return [
        name,
        f"{start:.3f}" if start == end else f"{start:.3f}–{end:.3f}",
        f"{friction.estimate:.3f} ({friction.low:.3f}–{friction.high:.3f})" if friction else "—",
        network.condition if network else "—",
        verdict.condition,
    ]


def _friction(truth: dict[str, object], actuator: str) -> tuple[float, float]:
    actuators = truth["actuators"]
    assert isinstance(actuators, dict)
    friction = actuators[actuator]["friction_nm"]
    return friction["start"], friction["end"]


def _class(friction_nm: float) -> str:
    """Return the class by the limits of the profile ``paper``."""
    if friction_nm <= 0.375:
        return "normal"
    return "emergency" if friction_nm >= 0.875 else "degraded"


def _write(path: Path, assessments: dict[str, Assessment]) -> None:
    objects = [json.loads(assessment.to_json()) for assessment in assessments.values()]
    partial = path.with_suffix(".partial")
    partial.write_text(
        json.dumps({"schema": "mavhums.assessment/2", "assessments": objects}, indent=2) + "\n"
    )
    partial.replace(path)


if __name__ == "__main__":
    try:
        parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
        parser.add_argument("folder", type=Path, nargs="?", default=Path("demo"))
        sys.exit(main(parser.parse_args().folder))
    except MavhumsError as error:
        sys.exit(str(error))
