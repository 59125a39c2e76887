"""What is kept of recordings over real links: samples per stream, forward flight and judged seconds.

    python benchmarks/links.py FOLDER

FOLDER holds ``.tlog`` files and a ``truth.csv``, counted by another reader on the sender's own clock:
``file``, ``system``, ``n_…`` messages per stream, ``armed_sender_s``, ``forward_after_3s_sender_s`` (forward
flight without the first 3 s of each stretch, which are needed to believe it). The aim is to agree within 2 s
and 2 %. Where ``airspeed_sensor`` is ``no``, forward flight waits for the wind triangle and is not compared.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

from mavhums import Engine

STREAMS = ("ATTITUDE", "SERVO_OUTPUT_RAW", "VFR_HUD", "RAW_IMU")
BLOCK = 1 << 18


def main() -> None:
    """Print a line per log and stream, and how many agree."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    with (folder / "truth.csv").open(newline="") as file:
        agreements = [agrees(folder, row) for row in csv.DictReader(file)]
    print(f"\n{sum(agreements)} of {len(agreements)} logs agree within 2 s and 2 %")


def agrees(folder: Path, truth: dict[str, str]) -> bool:
    """Print what is kept of a log, beside the truth; return whether all of it agrees."""
    engine = Engine()
    content = (folder / truth["file"]).read_bytes()
    for k in range(0, len(content), BLOCK):
        engine.feed(content[k : k + BLOCK])
    engine.finish()
    assessment = engine.assessment(indicators=False)
    vehicle = int(truth["system"])
    kept = engine.received(vehicle)
    print(f"\n{truth['file']}")
    good = []
    for stream in STREAMS:
        sent, found = int(truth[f"n_{stream}"]), kept[stream].kept if stream in kept else 0
        good.append(abs(found - sent) <= 0.02 * sent)
        print(f"  {stream:17} {found:5} of {sent}{'' if good[-1] else '   <--'}")
    use = next(usage for usage in assessment.usage if usage.vehicle == vehicle)
    flown, true = use.forward_s or 0.0, float(truth["forward_after_3s_sender_s"])
    good.append(abs(flown - true) <= max(2.0, 0.02 * true) or truth["airspeed_sensor"] == "no")
    print(f"  forward flight    {flown:.0f} s of {true:.1f} s{'' if good[-1] else '   <--'}")
    print(f"  armed             {use.armed_s or 0.0:.1f} s of {float(truth['armed_sender_s']):.1f} s")
    for verdict in assessment.verdicts:
        if verdict.subject == "axis" and verdict.vehicle == vehicle:
            judged = f"{verdict.coverage.decidable} of {verdict.coverage.windows} s judged"
            print(f"  {verdict.actuator:17} {verdict.worst}, {judged}: {verdict.reason or ''}")
    return all(good)


if __name__ == "__main__":
    main()
