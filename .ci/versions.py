"""Print version pins for pip's ``-c``.

python .ci/versions.py lock      exact versions of all that the extras pull in, as pip resolves them now
python .ci/versions.py lowest    the lower bounds in pyproject.toml
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
BOUND = re.compile(r"(?P<name>[\w.-]+)(?:\[[^]]*\])?(?:>=|~=)(?P<version>[\d.]+)")
CUDA = ("nvidia-", "cuda-", "triton")
PINNED = "lint"  # what runs with the pins only


def locked() -> Iterator[str]:
    """Yield the pins of a resolution for this Python.

    torch keeps its pin: its CPU build must be at hand in that version. What only its CUDA builds need and
    local versions such as ``+cpu`` differ by platform, and are left out.
    """
    torch = next(
        pin for pin in (ROOT / "constraints.txt").read_text().splitlines() if pin.startswith("torch==")
    )
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed"]
    command += ["--report", "-", f"{ROOT}[all,dev,lint]", torch]
    report = subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout
    for package in json.loads(report)["install"]:
        name, version = package["metadata"]["name"], package["metadata"]["version"]
        if name != "mavhums" and not name.startswith(CUDA):
            yield f"{name.lower().replace('_', '-')}=={version.partition('+')[0]}"


def lowest() -> Iterator[str]:
    """Yield the lower bound of each direct dependency."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = (needed for extra, needed in project["optional-dependencies"].items() if extra != PINNED)
    for requirement in (*project["dependencies"], *(one for needed in extras for one in needed)):
        if bound := BOUND.match(requirement):
            yield f"{bound['name'].lower()}=={bound['version']}"


if __name__ == "__main__":
    print(*sorted({*(lowest() if sys.argv[1:] == ["lowest"] else locked())}), sep="\n")
