"""Render the pictures of recordings for the documentation.

    python examples/pictures.py demo docs/recordings

takes the logs that ``make demo`` leaves in the first folder, flies and judges what is missing there, and
draws every recording as the viewer opens it. The pictures of real logs need them: MAVHUMS_REAL_LOGS names
the folder.
"""

from __future__ import annotations

import os
import shutil
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega

from examples import readme_picture
from examples.picture import save
from mavhums import Engine, EngineOptions, MavhumsError, Options, analyse
from mavhums.learn import default_model
from mavhums.log import read_blocks
from mavhums.show.viewer import LiveViewer
from mavhums_sim import Flight, fly
from mavhums_sim.telemetry import messages

REAL_LOG = "UAVLogViewer__vtol.tlog"
ALFA_LOG = "2018-09-11-17-55-30_1_right_aileron_failure.tlog"
PROFILE = Path(__file__).parents[1] / "benchmarks" / "alfa.toml"
HOUR_S, REPEATS = 3600, 10


def main(demo: Path, pictures: Path) -> None:
    """Draw all pictures."""
    pictures.mkdir(parents=True, exist_ok=True)
    makers: dict[str, Callable[[Path, Path], None]] = {
        "healthy": lambda folder, out: _judged(folder / "friction-0.225.tlog", folder, out),
        "growing-friction": lambda folder, out: _judged(folder / "friction-growing.tlog", folder, out),
        "growing-friction-detail": _detail,
        "real-log": _real,
        "aileron-jammed": _alfa,
        "ten-hours": _ten_hours,
        "live": _live,
    }
    for name, make in makers.items():
        print(f"{pictures / name}.png", flush=True)
        make(demo, pictures / f"{name}.png")


def _judged(log: Path, demo: Path, picture: Path) -> None:
    recording = demo / f"{log.stem}.rrd"
    analyse(log, recording=recording)
    save(recording, picture)


def _detail(demo: Path, picture: Path) -> None:
    readme_picture.main(demo / "friction-growing.rrd", picture)


def _real(demo: Path, picture: Path) -> None:
    original, log = Path(os.environ.get("MAVHUMS_REAL_LOGS", "")) / REAL_LOG, demo / REAL_LOG
    if original.exists():
        shutil.copyfile(original, log)
        _judged(log, demo, picture)
    else:
        print(f"  kept as it is: no {REAL_LOG} in MAVHUMS_REAL_LOGS")


def _alfa(demo: Path, picture: Path) -> None:
    """Draw a flight of the ALFA data set, judged by its outputs and the aircraft's answer alone."""
    log = Path(os.environ.get("MAVHUMS_REAL_LOGS", "")) / "alfa" / ALFA_LOG
    if not log.exists():
        print(f"  kept as it is: no {log.name} in MAVHUMS_REAL_LOGS/alfa")
        return
    recording = demo / f"{picture.stem}.rrd"
    shutil.copyfile(log, demo / log.name)
    analyse(demo / log.name, Options(airframe=PROFILE), recording=recording)
    save(recording, picture)


def _ten_hours(demo: Path, picture: Path) -> None:
    log = demo / "ten-hours.tlog"
    if not log.exists():
        partial = log.with_suffix(".partial")
        write_ten_hours(partial)
        partial.replace(log)
    _judged(log, demo, picture)


def write_ten_hours(path: Path, hour_s: float = HOUR_S) -> None:
    """Write a flight of ten hours in gusts; in the seventh hour the elevator's friction starts to grow.

    An hour is six minutes ten times over: simulating them all would take minutes and sixteen gigabytes.
    """
    part_s = hour_s / REPEATS
    link = ardupilotmega.MAVLink(None, srcSystem=1, srcComponent=1)
    start_us = 1_767_258_000_000_000
    with path.open("wb") as file:
        for hour in range(10):
            friction = 0.225 if hour < 6 else 0.55 + 0.03 * (hour - 6)
            flight = Flight(
                seed=hour,
                duration_s=part_s,
                rate_hz=10.0,
                cyclogram="gusts",
                tiers=("instrumented",),
                friction_nm={"elevator": (friction, friction)},
            )
            sent = list(messages(fly(flight)))
            times = [(getattr(m, "time_usec", None), getattr(m, "time_boot_ms", None)) for _, m in sent]
            for repeat in range(REPEATS):
                shift_s = hour * hour_s + repeat * part_s
                for (time_s, message), (usec, boot_ms) in zip(sent, times, strict=True):
                    if usec is not None:
                        message.time_usec = usec + round(shift_s * 1e6)
                    if boot_ms is not None:
                        message.time_boot_ms = boot_ms + round(shift_s * 1e3)
                    received = start_us + round((shift_s + time_s) * 1e6)
                    file.write(struct.pack(">Q", received) + bytes(message.pack(link)))


def _live(demo: Path, picture: Path) -> None:
    """Render a flight in progress, as a live viewer shows it."""
    engine = Engine(EngineOptions(models=[default_model()], vehicle_states=True))
    with LiveViewer("serve", recording_id="live") as viewer:
        blocks = list(read_blocks(demo / "friction-growing.tlog", size=4096))
        for block in blocks[: len(blocks) * 2 // 3]:
            viewer.consume(engine.feed(block))
        time.sleep(0.5)
        viewer.consume([])
        save(viewer.url, picture)
        viewer.close(engine.assessment())


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: pictures.py FOLDER PICTURES")
    try:
        main(Path(sys.argv[1]), Path(sys.argv[2]))
    except (ImportError, MavhumsError) as error:
        sys.exit(f"{error}; the pictures need the extra mavhums[viewer] and pillow")
