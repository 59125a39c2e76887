"""Data flows one way: a module imports from its own room and from rooms below it, and there is no circle."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from itertools import combinations
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

FLOORS = (
    "core",
    "log",
    "report",
    "vehicle",
    "actuator",
    "learn",
    "health",
    "engine",
    "flights",
    "show",
    "app",
    "training",
    "live",
    "study",
    "fleet",
    "serve",
    "cli",
)
"""Rooms from the ground up; a module may import from its own room and from those before it."""

APART = {frozenset(pair) for pair in combinations(("fleet", "live", "serve", "study", "training"), 2)}
"""Applications that stand side by side on ``app`` and do not import each other."""

LEAF = "learn"
"""Nothing that reads logs may import it."""
READS_LOGS = ("log", "report", "vehicle", "actuator")


def modules() -> dict[str, Path]:
    found = {}
    for base, package in ((ROOT, "mavhums"), (ROOT / "sim", "mavhums_sim")):
        for path in sorted((base / package).rglob("*.py")):
            parts = path.relative_to(base).with_suffix("").parts
            found[".".join(parts).removesuffix(".__init__")] = path
    return found


MODULES = modules()


def room(module: str) -> str:
    """Return the folder of ``mavhums`` that a module lies in, or its package where it lies in none."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 and parts[0] == "mavhums" else parts[0]


def imports(module: str, *, at_start: bool = False) -> Iterator[str]:
    """Yield the modules that one imports: anywhere in it, or ``at_start`` only when it is itself imported."""
    tree = ast.parse(MODULES[module].read_text(encoding="utf-8"))
    nodes = list(_run_at_start(tree.body)) if at_start else list(ast.walk(tree))
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from (name if name in MODULES else node.module for name in inner)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def _run_at_start(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    for node in body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif isinstance(node, ast.If) and ast.unparse(node.test) != "TYPE_CHECKING":
            yield from _run_at_start(node.body + node.orelse)
        elif isinstance(node, ast.Try):
            yield from _run_at_start(node.body)


def test_every_module_lies_in_a_room() -> None:
    rooms = {room(module) for module in MODULES} - {"mavhums", "mavhums_sim", "__main__"}
    assert rooms == set(FLOORS)
    assert [path.name for path in sorted((ROOT / "mavhums").glob("*.py"))] == ["__init__.py", "__main__.py"]


@pytest.mark.parametrize("module", [name for name in MODULES if room(name) in FLOORS])
def test_a_module_imports_only_from_rooms_below(module: str) -> None:
    here = room(module)
    for target in imports(module):
        there = room(target)
        if there in FLOORS and there != here:
            assert FLOORS.index(there) < FLOORS.index(here), f"{module} imports {target}, which lies above it"
            assert frozenset((here, there)) not in APART, f"{module} imports {target}, which stands beside it"
            assert not (here in READS_LOGS and there == LEAF), f"{module} imports {target}"


@pytest.mark.parametrize("module", [name for name in MODULES if name.startswith("mavhums_sim")])
def test_the_simulator_is_an_independent_witness(module: str) -> None:
    assert not [name for name in imports(module) if name == "mavhums" or name.startswith("mavhums.")]


@pytest.mark.parametrize("module", [name for name in MODULES if room(name) in FLOORS])
def test_only_training_and_studies_fly_the_simulator(module: str) -> None:
    flies = any(target.split(".")[0] == "mavhums_sim" for target in imports(module))
    assert not flies or room(module) in ("training", "study")


def test_no_import_runs_in_a_circle() -> None:
    graph = {}
    for module in MODULES:
        targets = {target for target in imports(module, at_start=True) if target in MODULES}
        graph[module] = {target for target in targets if not module.startswith(f"{target}.")} - {module}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" → ".join(error.args[1]))
