"""Simulated friction that grows with the load, as read: ``python benchmarks/load_friction.py``.

*Data sheet*: eight simulated flights of 60 s with the elevator at each of the paper's frictions, the other
surfaces healthy; μ of the EMA is 0 or 0.3. Each is judged with a profile that says 0 (the paper's), nothing,
or 0.3 ± 0.1. *Own history*: an aircraft without a data sheet and μ = 0.3, 20 flights before, five modes in
turn. *Registers*: angle, voltage, speed and current come in steps, the speed late, the current without a sign
and refreshed once a second, and samples are lost, as on a bus servo (``mavhums_sim.sensors.Registers``).
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np

import mavhums
from benchmarks._fleet import MODES
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.self_baseline.verdict import compare_with_own_flights
from mavhums.paper.real import rate
from mavhums.results.verdict import Verdict
from mavhums_sim import EmaParameters, Flight, FlightRecord, fly, write_tlog
from mavhums_sim.campaign import PAPER_FRICTION_NM
from mavhums_sim.conditions import Condition
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.sensors import Registers

PROFILES = {"0.0": "load_friction = 0.0", "not said": "", "0.3 ± 0.1": "load_friction = 0.3"}
TELEMETRY = {"sensors": None, "registers": Registers()}
AIRCRAFT, BEFORE, HEALTHY_NM = 40, 20, 0.225
RISES = (0.0, 0.25, 0.5, 1.0)


def judged(record: FlightRecord, folder: Path, airframe: Path) -> list[Verdict]:
    """Return the verdicts of the actuators of a flight."""
    log = folder / "flight.tlog"
    write_tlog(record, log)
    verdicts = mavhums.analyse(log, mavhums.Options(airframe=airframe)).verdicts
    return [verdict for verdict in verdicts if verdict.subject == "actuator"]


def sheet_rows(folder: Path, seconds: float) -> Iterator[str]:
    """Yield the table of the data sheet, row by row."""
    yield "| μ of the EMA | read by | profile says | actuators | right | wrong | undecided | error, N·m |"
    yield "|---|---|---|---|---|---|---|---|"
    airframes: dict[str, Path] = {}
    paper = (files("mavhums.actuator") / "airframes" / "paper.toml").read_text(encoding="utf-8")
    for said, line in PROFILES.items():
        airframes[said] = folder / f"profile-{len(airframes)}.toml"
        text = re.sub("load_friction = 0.0\n", f"{line}\n" if line else "", paper)
        airframes[said].write_text(text.replace('"paper"', '"mine"', 1), encoding="utf-8")
    for mu in (0.0, 0.3):
        parameters = replace(EmaParameters.from_data_sheet(), load_friction=mu)
        for telemetry, registers in TELEMETRY.items():
            flown = [
                fly(
                    Flight(
                        k, seconds, {"elevator": (nm, nm)}, parameters=parameters,
                        tiers=("instrumented",), registers=registers,
                    )
                )
                for k, nm in enumerate(PAPER_FRICTION_NM)
            ]  # fmt: skip
            for said, airframe in airframes.items():
                cells = _against_truth([judged(one, folder, airframe) for one in flown])
                yield f"| μ = {mu:g} | {telemetry} | {said} | {cells} |"


def _against_truth(flights: Sequence[list[Verdict]]) -> str:
    said, errors = Counter[str](), []
    for verdicts, nm in zip(flights, PAPER_FRICTION_NM, strict=True):
        for verdict in verdicts:
            true_nm = nm if verdict.actuator == "elevator" else min(PAPER_FRICTION_NM)
            truth = "emergency" if true_nm > 0.5 else "normal"
            right = "right" if verdict.condition == truth else "wrong"
            said["undecided" if verdict.condition == "undecided" else right] += 1
            errors += [verdict.friction_nm.estimate - true_nm] if verdict.friction_nm else []
    spread = f"{np.mean(errors):+.3f} ± {np.std(errors):.3f}" if errors else "–"
    counts = (said.total(), said["right"], said["wrong"], said["undecided"])
    return f"{' | '.join(map(str, counts))} | {spread.replace('-', '−')}"


def own_rows(folder: Path, seconds: float, each: int) -> Iterator[str]:
    """Yield the table of the own history, row by row."""
    cells = " | ".join(f"+{100 * rise:.0f} % found" for rise in RISES[1:])
    yield f"| read by | judged by | healthy | least rise, median (range) | {cells} |"
    yield "|---|---|---|---|---|---|---|"
    blank = folder / "blank.toml"
    blank.write_text(
        'name = "blank"\n'
        + "".join(
            f'[[actuators]]\nname = "{surface}"\nservo = {k}\npwm_us = [1000, 1500, 2000]\n'
            for k, surface in enumerate(SURFACES, 1)
        ),
        encoding="utf-8",
    )
    for telemetry, registers in TELEMETRY.items():
        yield f"| {telemetry} | {_own_row(folder, blank, registers, seconds, each)} |"


def _own_row(folder: Path, blank: Path, registers: Registers | None, seconds: float, each: int) -> str:
    def flight(number: int, rise: float) -> dict[str, Verdict]:
        worn = (Condition("friction", rise * HEALTHY_NM, rise * HEALTHY_NM),) if rise else ()
        record = fly(
            Flight(
                number, seconds, individuals=AIRCRAFT, cyclogram=MODES[number % len(MODES)],
                parameters=replace(EmaParameters.from_data_sheet(), load_friction=0.3),
                conditions=dict.fromkeys(SURFACES, worn), tiers=("instrumented",), registers=registers,
            )
        )  # fmt: skip
        return {verdict.actuator: verdict for verdict in judged(record, folder, blank)}

    before = [flight(number, 0.0) for number in range(BEFORE)]
    past = {
        surface: [PastRecord(one[surface].own, f"2025-01-{k:02d}", True) for k, one in enumerate(before, 1)]
        for surface in SURFACES
    }
    least, judged_by = list[float](), Counter[str]()
    said = {rise: Counter[str]() for rise in RISES}
    for rise in RISES:
        for number in range(each):
            flown = flight(1000 + 100 * RISES.index(rise) + number, rise)
            for surface, verdict in flown.items():
                found = compare_with_own_flights(verdict, past[surface])
                said[rise][found.condition] += 1
                rises = {one.fault: one.least_rise for one in found.indicators if one.least_rise is not None}
                judged_by.update(rises)
                least += () if rise else rises.values()
    of = said[0.0].total()
    healthy = ", ".join(f"{count} {text}" for text, count in said[0.0].most_common())
    spread = f"{np.median(least):.0%} ({min(least):.0%}–{max(least):.0%})" if least else "–"
    cells = " | ".join(rate(said[rise]["changed"], of) for rise in RISES[1:])
    return f"{', '.join(judged_by) or '–'} | {healthy} | {spread} | {cells}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--each", type=int, default=12, help="judged flights of each rise, own history")
    parser.add_argument("--only", choices=("sheet", "own"))
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        if args.only != "own":
            for line in sheet_rows(Path(name), args.seconds):
                print(line, flush=True)
        if args.only != "sheet":
            print()
            for line in own_rows(Path(name), args.seconds, args.each):
                print(line, flush=True)


if __name__ == "__main__":
    main()
