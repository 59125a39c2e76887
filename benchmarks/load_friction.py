"""The paper's conditions, with friction that grows with the load: ``python benchmarks/load_friction.py``.

Eight simulated flights of 60 s with the elevator at each of the paper's frictions, the other surfaces
healthy; μ of the EMA is 0 or 0.3. Each is judged with a profile that says 0 (the paper's), nothing, or
0.3 ± 0.1. *Held*: the current is refreshed once a second, as a bus servo's register is.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np

import mavhums
from mavhums.core.quantities import column
from mavhums_sim import EmaParameters, Flight, FlightRecord, fly, write_tlog
from mavhums_sim.campaign import PAPER_FRICTION_NM

PROFILES = {"0": "load_friction = 0.0", "not said": "", "0.3 ± 0.1": "load_friction = 0.3"}
TELEMETRY = ("as measured", "held")
_CURRENTS = [column(key) for key in ("V5", "V8")]


def held(record: FlightRecord) -> FlightRecord:
    """Return the record with each current as it was at the last full second."""
    actuators = {}
    for surface, one in record.actuators.items():
        values = one.values.copy()
        second = np.floor(one.time_s)
        first = np.searchsorted(second, second)
        values[:, _CURRENTS] = values[first][:, _CURRENTS]
        actuators[surface] = replace(one, values=values)
    return replace(record, actuators=actuators)


def rows(seconds: float) -> Iterator[str]:
    """Yield the table, row by row."""
    yield "| μ of the EMA | current | profile says | right | wrong | undecided | error of friction, N·m |"
    yield "|---|---|---|---|---|---|---|"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        airframes = {}
        for said, line in PROFILES.items():
            airframes[said] = folder / f"profile-{len(airframes)}.toml"
            paper = (files("mavhums.actuator") / "airframes" / "paper.toml").read_text(encoding="utf-8")
            text = re.sub("load_friction = 0.0\n", f"{line}\n" if line else "", paper).replace(
                '"paper"', '"mine"', 1
            )
            airframes[said].write_text(text, encoding="utf-8")
        for mu in (0.0, 0.3):
            parameters = replace(EmaParameters.from_data_sheet(), load_friction=mu)
            flown = [
                fly(
                    Flight(k, seconds, {"elevator": (nm, nm)}, parameters=parameters, tiers=("instrumented",))
                )
                for k, nm in enumerate(PAPER_FRICTION_NM)
            ]
            for telemetry in TELEMETRY:
                logs = [folder / f"{k}.tlog" for k in range(len(flown))]
                for log, one in zip(logs, flown, strict=True):
                    write_tlog(held(one) if telemetry == "held" else one, log)
                for said, airframe in airframes.items():
                    yield f"| {mu:g} | {telemetry} | {said} | {_judged(logs, airframe)} |"


def _judged(logs: list[Path], airframe: Path) -> str:
    said, errors = Counter[str](), []
    for log, nm in zip(logs, PAPER_FRICTION_NM, strict=True):
        for verdict in mavhums.analyse(log, mavhums.Options(airframe=airframe)).verdicts:
            if verdict.subject != "actuator":
                continue
            true_nm = nm if verdict.actuator == "elevator" else min(PAPER_FRICTION_NM)
            truth = "emergency" if true_nm > 0.5 else "normal"
            right = "right" if verdict.condition == truth else "wrong"
            said["undecided" if verdict.condition == "undecided" else right] += 1
            errors += [verdict.friction_nm.estimate - true_nm] if verdict.friction_nm else []
    spread = f"{np.mean(errors):+.3f} ± {np.std(errors):.3f}" if errors else "–"
    return f"{said['right']} | {said['wrong']} | {said['undecided']} | {spread}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    for line in rows(parser.parse_args().seconds):
        print(line, flush=True)
