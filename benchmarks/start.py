"""Start-up and speed of ``mavhums analyse``: ``python benchmarks/start.py [LOG …]``.

Processor seconds, the least of several runs: a whole command on a log of half a minute, what its imports
alone cost, and the verdict on a 4 MB log of four actuators when everything is loaded; then both for
each log that is named. Other work on the machine makes the figures larger: the load is printed.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mavhums import analyse
from mavhums_sim import Flight, fly, write_tlog

PARTS = {
    "numpy": "import numpy",
    "numpy and pandas": "import numpy, pandas",
    "numpy and scipy.special": "import scipy.special",
    "pydantic": "import pydantic; pydantic.BaseModel",
    "all imports of analyse": "import mavhums.app.analysis, mavhums.cli.main, mavhums.engine.engine",
}
TIMES = 7


def spent_s(arguments: list[str], bytecode: Path) -> float:
    """Return the least processor time of a command, whose modules' bytecode is kept in a folder."""
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": str(bytecode)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    best = float("inf")
    for _ in range(TIMES):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, *arguments]
        subprocess.run(command, check=False, stdout=subprocess.DEVNULL, env=environment)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        best = min(best, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return best


def warm_s(log: Path) -> float:
    """Return the least processor time of a verdict in this process, after a first one."""
    analyse(log)
    best = float("inf")
    for _ in range(2 * TIMES):
        begun = time.process_time()
        analyse(log)
        best = min(best, time.process_time() - begun)
    return best


def main() -> None:
    logs = [Path(log) for log in sys.argv[1:]]
    with tempfile.TemporaryDirectory() as folder:
        short, long, bytecode = (Path(folder, name) for name in ("short.tlog", "long.tlog", "bytecode"))
        for path, seconds in ((short, 30.0), (long, 210.0)):
            write_tlog(fly(Flight(seed=1, duration_s=seconds, rate_hz=50.0, tiers=("instrumented",))), path)
        print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; processor seconds")
        for name, code in PARTS.items():
            print(f"{name}: {spent_s(['-c', code], bytecode):.2f}")
        print(f"mavhums analyse, {short.stat().st_size / 1e6:.1f} MB: ", end="")
        print(f"{spent_s(['-m', 'mavhums', 'analyse', str(short)], bytecode):.2f}")
        print(f"verdict, warm, {long.stat().st_size / 1e6:.1f} MB: {warm_s(long):.3f}")
        for log in logs:
            command_s = spent_s(["-m", "mavhums", "analyse", str(log)], bytecode)
            print(f"{log.name}, {log.stat().st_size / 1e6:.1f} MB: {command_s:.2f}, warm {warm_s(log):.3f}")


if __name__ == "__main__":
    main()
