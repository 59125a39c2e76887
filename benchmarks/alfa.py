"""Detection of failed surfaces on real flights from ordinary messages: detection, delay and named surface.

    python benchmarks/alfa.py FOLDER [--airframe PROFILE] [--radio N]

FOLDER holds flights and a ``labels.csv``: of the ALFA data set (Keipour, Mousaei, Scherer, IJRR 2021, doi
10.1177/0278364920966642), or of flights labelled by boot time. Where the logs carry no parameters, as ALFA's,
the evaluation runs twice: with the outputs named by a profile, ``benchmarks/alfa.toml`` unless another is
given, and with the outputs inferred from each flight's own beginning.

Frozen servo outputs, ``DISABLE_*`` parameters and STATUSTEXT are never evidence. Delays count to the end of
the second of data that made the finding certain; live, it settles once every stream has passed it.

``--radio`` sends each .tlog through N draws of a radio's latency and losses as well, and prints which
conditions and which delays depend on the draw.

For comparison: A. Keipour, M. Mousaei, S. Scherer, "Automatic real-time anomaly detection for autonomous
aerial vehicles", ICRA 2019: recursive least squares on commanded and flown attitude, 2.0 s and about 86 %
of 22 flights, in which engine failures count as anomalies to be found; here they must not be flagged.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from statistics import median

from benchmarks._flown_faults import Flight, Outcome, judge, judge_bytes, read_labels, summary
from mavhums.core.errors import MavhumsError
from mavhums.vehicle.parameters import read_parameters
from mavhums_sim.perturb import perturb


def main() -> None:
    """Judge every flight of a folder and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--airframe", default=None)
    parser.add_argument(
        "--radio", type=int, default=0, metavar="N", help="draws of a radio's latency and losses"
    )
    arguments = parser.parse_args()
    flights = [*read_labels(arguments.folder)]
    named_by_logs = _names_outputs(flights[0].path)
    named = arguments.airframe or (None if named_by_logs else Path(__file__).with_name("alfa.toml"))
    first = "outputs by the logs' own parameters" if named is None else f"outputs named by {Path(named).name}"
    _report(first, [judge(flight, named) for flight in flights])
    if not named_by_logs:
        _report("outputs inferred from each flight", [judge(flight, None) for flight in flights])
    if arguments.radio:
        _report_draws([flight for flight in flights if flight.path.suffix == ".tlog"], named, arguments.radio)


def _names_outputs(path: Path) -> bool:
    try:
        return "SERVO1_FUNCTION" in read_parameters(path).values
    except MavhumsError:  # no parameters at all
        return False


def _report(title: str, outcomes: Sequence[Outcome]) -> None:
    print(f"\n## {title}\n")
    for outcome in outcomes:
        print(_line(outcome))
    print()
    print("\n".join(summary(outcomes)))


def _report_draws(flights: Sequence[Flight], named: str | Path | None, draws: int) -> None:
    """Print what depends on the phase of the samples: conditions, faults found, and delays."""
    print(f"\n## as recorded, and through {draws} draws of a radio\n")
    differ, partly, faults, spreads, false = 0, 0, 0, [], 0
    for flight in flights:
        content = flight.path.read_bytes()
        logs = [content, *(perturb(content, "radio", seed) for seed in range(draws))]
        outcomes = [judge_bytes(flight, [log], named) for log in logs]
        conditions = {tuple(sorted(outcome.conditions.items())) for outcome in outcomes}
        differ += len(conditions) > 1
        false += sum(bool(outcome.false_alarms()) for outcome in outcomes)
        results = [", ".join(f"{axis} {condition}" for axis, condition in one) for one in sorted(conditions)]
        for fault in (fault for fault in flight.faults if not fault.confounds):
            found = [outcome.found(fault) for outcome in outcomes]
            delays = [alarms[0].time_s - fault.start_s for alarms in found if alarms]
            faults += 1
            partly += 0 < len(delays) < len(found)
            spreads += [max(delays) - min(delays)] if delays else []
            results.append(f"{fault.surface} found in {len(delays)} of {len(found)}")
            results[-1] += f" after {min(delays):.0f} to {max(delays):.0f} s" if delays else ""
        print(f"{flight.path.name}: {'; '.join(results)}")
    moved = f"{median(spreads or [0.0]):.0f} s in the median, {max(spreads or [0.0]):.0f} s at most"
    print(f"\nconditions differ in {differ} of {len(flights)} flights")
    print(f"faults that are found in some draws only: {partly} of {faults}; delays move by {moved}")
    print(f"logs with a false alarm: {false} of {len(flights) * (draws + 1)}")


def _line(outcome: Outcome) -> str:
    judged = ", ".join(
        f"{axis} {condition} ({outcome.judged[axis][0]}/{outcome.judged[axis][1]} s)"
        for axis, condition in outcome.conditions.items()
    )
    lines = [f"{outcome.flight.path.name}: {judged}"]
    for fault in outcome.flight.faults:
        found = "; ".join(
            f"{a.actuator} {a.fault} {a.after} after {a.time_s - fault.start_s:.1f} s"
            for a in (outcome.found(fault) if not fault.confounds else [])
        )
        left = fault.end_s - fault.start_s
        lines.append(f"    {fault.surface} ({fault.kind}), {left:.0f} s left: {found or 'nothing found'}")
    lines += [
        f"    FALSE ALARM {a.actuator} {a.fault} {a.after} at {a.time_s:.0f} s"
        for a in outcome.false_alarms()
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
