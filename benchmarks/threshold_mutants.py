"""Do the quick tests notice a moved threshold? Each number of health's, moved by a quarter.

    python benchmarks/threshold_mutants.py --sample 60 --seed 1
    python benchmarks/threshold_mutants.py --only YAW_SHIFT

A sample moves each number one way, ``--only`` both. Each is moved in a copy of the tree, in which the quick
tests of its room, the figures and the other tests of health run, up to the first that fails.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from mavhums.core.kernels import SOURCES, digest, is_built

ROOT = Path(__file__).parents[1]
HEALTH = Path("mavhums", "health")
COPIED = ("mavhums", "sim", "tests", "conftest.py", "pyproject.toml")
TESTS = ("tests/health/{room}", "tests/test_figures.py", "tests/health")
FACTORS = (0.75, 1.25)
NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d*)?(?:e-?\d+)?")
KERNEL = re.compile(r"^@(kernel|subroutine|inlined)\b", re.MULTILINE)


def assignments(path: Path) -> dict[str, str]:
    """Return what a module assigns to each of its constants."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    pairs = [(one.target, one.value) for one in body if isinstance(one, ast.AnnAssign)]
    return {ast.unparse(name): ast.unparse(value) for name, value in pairs if value}


def numbers() -> list[tuple[str, str]]:
    """Return each room and name with a number of its own."""
    return [
        (path.parent.name, name)
        for path in sorted((ROOT / HEALTH).rglob("thresholds.py"))
        for name, value in assignments(path).items()
        if NUMBER.search(value)
    ]


def drawn(count: int, seed: int) -> list[tuple[str, str, float]]:
    """Return a sample with a factor for each; a number that goes leaves the order of the others."""
    order = []
    for room, name in numbers():
        chance = random.Random(f"{seed} {room} {name}")
        order.append((chance.random(), room, name, chance.choice(FACTORS)))
    return [(room, name, factor) for _, room, name, factor in sorted(order)[:count]]


def move(path: Path, name: str, factor: float) -> None:
    """Write each number of an assignment anew, integers moved by one at least."""

    def moved(found: re.Match[str]) -> str:
        value = ast.literal_eval(found[0])
        if isinstance(value, float):
            return repr(value * factor)
        return str(value + (round(value * (factor - 1.0)) or (1 if factor > 1.0 else -1)))

    module = ast.parse(path.read_text(encoding="utf-8"))
    for one in module.body:
        if isinstance(one, ast.AnnAssign) and one.value and ast.unparse(one.target) == name:
            one.value = ast.parse(NUMBER.sub(moved, ast.unparse(one.value)), mode="eval").body
    path.write_text(ast.unparse(module), encoding="utf-8")


def is_compiled(name: str) -> bool:
    """Return whether a module with kernels names the number, or one that rests on it."""
    paths = [*(ROOT / HEALTH).rglob("*.py")]
    words = [
        (key, {*re.findall(r"\w+", value)}) for path in paths for key, value in assignments(path).items()
    ]
    names = {name}
    while more := {key for key, used in words if names & used} - names:
        names |= more
    texts = [text for path in paths if KERNEL.search(text := path.read_text(encoding="utf-8"))]
    return any(names & {*re.findall(r"\w+", text)} for text in texts)


def killer(room: str, name: str, factor: float, tree: Path) -> str:
    """Return the first test that notices the move; none does if empty."""
    for part in COPIED:
        copy = shutil.copytree if (ROOT / part).is_dir() else shutil.copy
        copy(ROOT / part, tree / part)
    move(tree / HEALTH / room / "thresholds.py", name, factor)
    package, environment = tree / "mavhums", os.environ | {"PYTHONPATH": f"{tree}{os.pathsep}{tree / 'sim'}"}
    if is_built():  # else numba compiles what is called
        if is_compiled(name):
            build = [sys.executable, "-m", "mavhums.core.build", "health"]
            subprocess.run(build, cwd=tree, env=environment, capture_output=True, check=True)
        _, *names = (package / SOURCES).read_text(encoding="utf-8").splitlines()
        text = "\n".join([digest(package / name for name in names), *names])
        (package / SOURCES).write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", "not slow", "-p", "no:cacheprovider"]
    command += [test.format(room=room) for test in TESTS]
    done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", done.stdout, re.MULTILINE)
    return failed[1] if failed else f"pytest, which ends with {done.returncode}" * bool(done.returncode)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sample", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="+", metavar="NAME")
    options = parser.parse_args()
    moves = drawn(options.sample, options.seed)
    if options.only:
        moves = [(*one, factor) for one in numbers() if one[1] in options.only for factor in FACTORS]
    survived = 0
    print("| number | times | killed by |", "|---|---|---|", sep="\n", flush=True)
    for room, name, factor in moves:
        with tempfile.TemporaryDirectory() as folder:
            test = killer(room, name, factor, Path(folder))
        survived += not test
        print(f"| {room}: {name} | {factor} | {test or 'none'} |", flush=True)
    print(f"\n{survived} of {len(moves)} survive")


if __name__ == "__main__":
    main()
