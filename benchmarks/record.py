"""Recordings: time to write and to open, size, and memory.

    python benchmarks/record.py

Flights are arrays from a fixed seed, as the engine's events would bring them, in blocks of a second; what is
timed is the recorder alone. The viewer opens each file without a screen, as tests/show/test_picture.py does.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from examples.picture import alike
from mavhums.actuator.mapping import AirframeNamed, Samples
from mavhums.actuator.profile import load_airframe
from mavhums.core.conditions import Condition
from mavhums.engine.events import Event
from mavhums.health.decision.events import ConditionChanged, Window
from mavhums.log.base.decoder import Losses
from mavhums.results.assessment import Assessment, LogSummary
from mavhums.results.verdict import Interval, Verdict
from mavhums.vehicle.states import Attitude, Position

PORT = 9877
CASES = {  # seconds, actuators, hertz; goals: seconds to write, megabytes, seconds to open and draw
    "100 s × 4 × 100 Hz": (100, 4, 100, 0.5, 10, None),
    "1 h × 8 × 100 Hz": (3600, 8, 100, 10, 60, 5),
    "10 h × 16 × 100 Hz": (36000, 16, 100, None, None, None),
}


def airframe(actuators: int) -> AirframeNamed:
    paper = load_airframe("paper")
    parts = [
        paper.actuators[k % 4].model_copy(
            update={"name": f"{paper.actuators[k % 4].name}_{k // 4 + 1}", "servo": k + 1}
        )
        for k in range(actuators)
    ]
    return AirframeNamed(0.0, None, paper.model_copy(update={"actuators": tuple(parts)}))


def flight(seconds: int, actuators: int, rate: int) -> Iterator[list[Event]]:
    """Yield the events of one second after another; the first actuator is degraded from the middle on."""
    named = airframe(actuators)
    names = [part.name for part in named.airframe.actuators]
    rng = np.random.default_rng(1)
    noise = rng.normal(size=(rate, 12)).astype(np.float32).astype(np.float64)
    yield [named]
    for second in range(seconds):
        time_s = second + np.arange(rate) / rate
        swing = np.sin(0.7 * time_s)[:, None] * 10
        slow = second + np.arange(25) / 25
        events: list[Event] = [
            Attitude(1, slow, np.stack([np.sin(slow / 5) / 3, slow * 0, slow / 60], axis=1))
        ]
        degrees = np.array([[51 + second / 1e5, second / 1e5]])
        events.append(Position(1, np.array([float(second)]), degrees, np.array([100.0])))
        for k, name in enumerate(names):
            events.append(Samples(1, name, time_s, noise + swing, np.ones(noise.shape, dtype=bool)))
            if second >= 9:
                value = 0.5 if k == 0 and second > seconds / 2 else 0.225
                interval = Interval(estimate=value, low=value - 0.02, high=value + 0.02)
                state: Condition = "degraded" if value > 0.4 else "normal"
                events.append(
                    Window(1, name, second - 9.0, second + 1.0, 0.8, interval, state, "normal", 0.99, 0.01)
                )
                if second == seconds // 2 + 1 and k == 0:
                    since = float(seconds // 2)
                    events.append(
                        ConditionChanged(1, name, second + 1.0, since, "normal", "degraded", "rule")
                    )
        yield events


def write(case: str, path: Path) -> None:
    """Write one recording and print its cost, in a separate process with its own memory."""
    from mavhums.show.recorder import Recorder

    seconds, actuators, rate, *_ = CASES[case]
    names = [part.name for part in airframe(actuators).airframe.actuators]
    summary = LogSummary(
        path="flight.tlog", sha256=None, start_utc=None, duration_s=seconds, vehicles=(1,), losses=Losses()
    )
    verdicts = tuple(Verdict(vehicle=1, actuator=n, condition="normal", worst="normal") for n in names)
    assessment = Assessment(log=summary, airframe="paper", model=None, verdicts=verdicts)
    with Recorder(path.with_suffix(".warm"), recording_id="warm") as recorder:
        recorder.close(assessment)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    spent = worked = 0.0
    with Recorder(path, recording_id="benchmark") as recorder:
        for events in flight(seconds, actuators, rate):
            start = time.perf_counter(), time.process_time()
            recorder.consume(events)
            spent, worked = spent + time.perf_counter() - start[0], worked + time.process_time() - start[1]
        start = time.perf_counter(), time.process_time()
        recorder.close(assessment)
        spent, worked = spent + time.perf_counter() - start[0], worked + time.process_time() - start[1]
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    print(f"{spent:.2f} {worked:.2f} {grown:.0f}")


def show(path: Path, patience_s: float = 120.0) -> tuple[float, float]:
    """Return the time from opening the file to a stable picture, s, and the viewer's memory, MB.

    Further pictures, which only confirm stability, do not count.
    """
    import rerun_cli
    from rerun.experimental import ViewerClient

    program = str(Path(rerun_cli.__file__).with_name("rerun"))
    with ViewerClient.spawn(
        headless=True, hide_welcome_screen=True, port=PORT, executable_path=program, memory_limit="2GB"
    ) as client:
        client.take_screenshot()
        start = time.perf_counter()
        client.open(str(path))
        before, drawn, rest = b"", b"", 0.0
        while not alike(before, drawn) or client.get_state().loading or not client.get_state().recordings:
            before, drawn = drawn, client.take_screenshot()
            if not alike(before, drawn):
                rest = time.perf_counter() - start
            if rest > patience_s:
                raise TimeoutError(f"{path}: the viewer does not come to rest")
            time.sleep(0.1)
        found = subprocess.run(
            ["pgrep", "-n", "-f", "--", f"--port={PORT}"], capture_output=True, text=True, check=True
        )
        status = Path(f"/proc/{int(found.stdout)}/status").read_text()
        memory = int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1])
    return rest, memory / 1024


def main() -> None:
    """Print the table."""
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    titles = (
        "flight",
        "write, s",
        "goal",
        "CPU, s",
        "MB",
        "goal",
        "writer grows by, MB",
        "open and draw, s",
        "goal",
        "viewer, MB",
    )
    print(f"| {' | '.join(titles)} |", flush=True)
    print("|---" * len(titles) + "|")
    with tempfile.TemporaryDirectory() as folder:
        for case, (*_, write_goal, size_goal, open_goal) in CASES.items():
            path = Path(folder) / "flight.rrd"
            command = [sys.executable, __file__, case, str(path)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            spent, worked, grown = done.stdout.split()
            program = str(Path(sys.executable).with_name("rerun"))
            subprocess.run([program, "rrd", "verify", str(path)], check=True, capture_output=True)
            opened, memory = show(path)
            size = path.stat().st_size / 1e6
            goals = [f"≤ {goal}" if goal else "—" for goal in (write_goal, size_goal, open_goal)]
            cells = [case, spent, goals[0], worked, f"{size:.1f}", goals[1], grown]
            cells += [f"{opened:.1f}", goals[2], f"{memory:.0f}"]
            print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    if len(sys.argv) == 3:
        write(sys.argv[1], Path(sys.argv[2]))
    else:
        main()
