"""Judge the actuators of one log, and act on the answer.

    python examples/analyse_a_log.py flight.tlog [AIRFRAME]

AIRFRAME is a profile's name or file; without it, the one that the log names itself is taken.
"""

from __future__ import annotations

import sys

import mavhums


def main(path: str, airframe: str | None = None) -> int:
    """Print the verdicts of a log, the worst first; return how many actuators need work."""
    assessment = mavhums.analyse(path, mavhums.Options(airframe=airframe))
    to_do = 0
    for verdict in assessment.ranked():
        print(f"{verdict.actuator}: {verdict.condition}")
        if verdict.friction_nm:
            print(f"  friction {verdict.friction_nm.estimate:.3f} N·m", end="")
            print(f" ({verdict.friction_nm.low:.3f} to {verdict.friction_nm.high:.3f})")
        if verdict.since:
            print(f"  since {verdict.since.flight_time_s:.0f} s of flight, {verdict.since.utc}")
        if verdict.reason:
            print(f"  because {verdict.reason}; {verdict.remedy}")
        to_do += verdict.gravest in ("degraded", "emergency")
    print(assessment.to_frame()[["actuator", "condition", "friction_nm"]].to_string(index=False))
    return to_do


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: analyse_a_log.py LOG [AIRFRAME]")
    try:
        print(f"{main(*sys.argv[1:3])} actuators need work")
    except mavhums.MavhumsError as error:
        sys.exit(str(error))
