"""Judge the tests: change the code in random places, one at a time, and run the tests that execute the place.

    pip install cosmic-ray==8.7.0
    python .ci/mutants.py map tests/*/                        which test executes which line: once, minutes
    python .ci/mutants.py sample 1 300 vehicle health > m1    300 places of these rooms, drawn with seed 1
    python .ci/mutants.py judge m1 > judged                   add a verdict to each, and print the survivors
    python .ci/mutants.py table judged                        how many survive, by room

A line of these files is one mutant: path, line, old text, new text, and later its verdict. Spared are
annotations, error texts, and compiled kernels with their constants, for which each mutant would have to be
compiled; a place counts once, however many mutants it has. A sample outlives renamed modules.
"""

from __future__ import annotations

import ast
import collections
import contextlib
import functools
import importlib
import json
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
STATE = Path(os.environ.get("MUTANTS", ROOT / "build" / "mutants"))
ROOMS = ("vehicle", "health", "flights", "engine", "live")
FOLDERS = {"history": "flights"}  # folders of tests that have another name than their room
COMPILED = {"kernel", "inlined"}
LOADED = ["hypothesis", "numba", "pandas", "pytest", "rich.progress"]
LOADED += ["scipy.optimize", "scipy.stats", "mavhums_sim"]
# Decorators whose absence changes no result.
SPARED = {"cache", "lru_cache", "override", "final", "dataclass"}
BITS = {"BitOr", "BitAnd", "BitXor", "RShift", "LShift"}
NEAR_S, MOST_S, MOST = 20.0, 50.0, 200  # of tests of whole logs or of the same room, of all; tests of each
MOST_WALL_S = 600.0
# Every Python that a test starts reads the changed text, too; the file stays, and with it numba's cache.
HOOK = """
import importlib.machinery, os
_code = importlib.machinery.SourceFileLoader.get_code
def _changed(self, name):
    if name != os.environ["MUTANT_OF"]:
        return _code(self, name)
    with open(os.environ["MUTANT"], encoding="utf-8") as file:
        return compile(file.read(), self.path, "exec", dont_inherit=True)
importlib.machinery.SourceFileLoader.get_code = _changed
"""


def make_map(folders: list[str]) -> None:
    """Run the tests of each folder under coverage, a context for each test."""
    (STATE / "map").mkdir(parents=True, exist_ok=True)
    source = "\n".join(f"  {ROOT}/mavhums/{room}" for room in ROOMS)
    (STATE / "rc").write_text(f"[run]\nparallel = true\nsource =\n{source}\n")
    for folder in folders:
        to = STATE / "map" / "-".join(Path(folder).parts[-2:])
        command = ["pytest", "-q", f"--timeout={NEAR_S:.0f}", "--cov", f"--cov-config={STATE / 'rc'}"]
        command += ["--cov-report=", "--cov-context=test", f"--junitxml={to}.xml"]
        command += ["-o", "junit_family=xunit1", folder]
        environment = {**os.environ, "COVERAGE_FILE": str(to)}
        subprocess.run([sys.executable, "-m", *command], cwd=ROOT, env=environment, check=False)


@functools.cache
def durations() -> dict[str, float]:
    """Return the seconds of each test that passed."""
    cases = [case for path in (STATE / "map").glob("*.xml") for case in ET.parse(path).iter("testcase")]
    passed = [case.attrib for case in cases if not len(case)]
    return {f"{case['file']}::{case['name']}": float(case.get("time", 1)) for case in passed}


@functools.cache
def tests_in(file: str) -> set[str]:
    """Return the tests of a file."""
    return {test for test in durations() if test.startswith(file + "::")}


@functools.cache
def maps() -> list[Any]:
    """Return the coverage data of all folders."""
    from coverage import CoverageData

    found = [CoverageData(report.with_suffix("")) for report in (STATE / "map").glob("*.xml")]
    for data in found:
        data.read()
    return found


@functools.cache
def tests_by_line(path: str) -> dict[int, set[str]]:
    """Return the tests that execute each line. A fixture belongs to all tests of its file."""
    found: dict[int, set[str]] = collections.defaultdict(set)
    for data in maps():
        for file in data.measured_files():
            for line, contexts in data.contexts_by_lineno(file).items() if file.endswith(path) else ():
                for test, _, phase in (context.rpartition("|") for context in contexts if context):
                    found[line] |= {test} if phase == "run" else tests_in(test.partition("::")[0])
    return found


@functools.cache
def parsed(path: str) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse((ROOT / path).read_text(encoding="utf-8"))


@functools.cache
def statements(path: str) -> dict[int, tuple[ast.stmt | ast.ExceptHandler, range, bool]]:
    """Return of each line its statement, that one's own lines, and whether it runs in a function."""
    found = {}

    def visit(tree: ast.AST, inside: bool) -> None:
        for node in ast.iter_child_nodes(tree):
            if isinstance(node, (ast.stmt, ast.ExceptHandler)):
                body = getattr(node, "body", None)
                first = min([node.lineno, *(each.lineno for each in getattr(node, "decorator_list", []))])
                lines = range(first, body[0].lineno if body else (node.end_lineno or 0) + 1)
                found.update(dict.fromkeys(lines, (node, lines, inside)))
            visit(node, inside or isinstance(node, ast.FunctionDef))

    visit(parsed(path), False)
    return found


@functools.cache
def users(name: str) -> list[tuple[str, int]]:
    """Return the lines of the package that name something."""
    pattern, paths = re.compile(rf"\b{name}\b"), (ROOT / "mavhums").rglob("*.py")
    lines = ((str(path.relative_to(ROOT)), k, text) for path in paths for k, text in numbered(path))
    return [(path, k) for path, k, text in lines if pattern.search(text) and "import" not in text]


@functools.cache
def numbered(path: Path) -> list[tuple[int, str]]:
    """Return the lines of a file."""
    return list(enumerate(path.read_text(encoding="utf-8").splitlines(), 1))


@functools.cache
def covering(path: str, line: int, depth: int = 0) -> frozenset[str]:
    """Return the tests that execute a line; of what runs at import, those of what names it."""
    if line not in statements(path):
        return frozenset()
    found, (node, lines, inside) = tests_by_line(path), statements(path)[line]
    tests = {test for each in lines for test in found[each]}
    if isinstance(node, ast.FunctionDef):  # a default, a decorator
        tests |= {test for each in range(node.lineno, (node.end_lineno or 0) + 1) for test in found[each]}
    elif not inside and not isinstance(node, (ast.Import, ast.ImportFrom)) and depth < 3:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", node)]
        names = {each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)}
        for name in {node.name} if isinstance(node, ast.ClassDef) else names:
            tests = tests.union(*(covering(*user, depth + 1) for user in users(name) if user != (path, line)))
            for file in (ROOT / "tests").rglob("test_*.py"):
                if any(re.search(rf"\b{name}\b", text) for _, text in numbered(file)):
                    tests |= tests_in(str(file.relative_to(ROOT)))
    return frozenset(tests)


def chosen(path: str, line: int) -> list[str]:
    """Return the tests for a mutant: of whole logs, then of its room, the quickest first, within the time."""

    def near(test: str) -> int:
        parts = [FOLDERS.get(part, part) for part in Path(test.partition("::")[0]).parts]
        alike = [a == b for a, b in zip(parts[1:-1], Path(path).parts[1:-1], strict=False)]
        # The figures of whole logs stand beside the folders of tests.
        return sum(alike) + (Path(path).stem in parts[-1]) + 9 * (len(parts) == 2)

    seconds, taken, total = durations(), [], 0.0
    tests = sorted(covering(path, line) & seconds.keys(), key=lambda test: (-near(test), seconds[test], test))
    for limit, group in (
        (NEAR_S, [t for t in tests if near(t) >= 9]),  # they take minutes, and must leave time for the room's
        (NEAR_S + NEAR_S, [t for t in tests if 0 < near(t) < 9]),
        (MOST_S, [t for t in tests if not near(t)]),
    ):
        for test in group[:MOST]:
            if taken and total + seconds[test] > limit:
                break
            taken.append(test)
            total += seconds[test] + 0.02
    return taken


@functools.cache
def named_in_kernels() -> set[str]:
    """Return the names that compiled functions use."""
    names: set[str] = set()
    for path in (ROOT / "mavhums").rglob("*.py"):
        if COMPILED & set(re.findall(r"^@(\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)):
            for node in ast.walk(parsed(str(path.relative_to(ROOT)))):
                if isinstance(node, ast.FunctionDef) and COMPILED & set(
                    map(ast.unparse, node.decorator_list)
                ):
                    names |= {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
                    names |= {each.attr for each in ast.walk(node) if isinstance(each, ast.Attribute)}
    return {name for name in names if name.isupper()}  # constants, not what is local


def spared(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield what no test can miss, or what is compiled."""
    kernels = named_in_kernels()
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef() if COMPILED & set(map(ast.unparse, node.decorator_list)):
                yield node
                yield from node.decorator_list
            case ast.keyword(arg="strict"):
                yield node.value
            case ast.FunctionDef() | ast.ClassDef():
                named = [(each, set(re.findall(r"\w+", ast.unparse(each)))) for each in node.decorator_list]
                yield from (each for each, names in named if SPARED & names)
                yield from filter(None, [getattr(node, "returns", None)])
            case ast.AnnAssign() if ast.unparse(node.target) in kernels:
                yield node
            case ast.arg(annotation=ast.expr()) | ast.AnnAssign():
                yield node.annotation
            case ast.Raise() | ast.If(test=ast.Name(id="TYPE_CHECKING")):
                yield node
            case ast.Assign() if kernels & {ast.unparse(target) for target in node.targets}:
                yield node


def wanted(operator: str) -> bool:
    """Return whether an operator makes a change that a reader could overlook, not a type error."""
    before, _, after = operator.rpartition("_")[0].rpartition("_")[2], "_", operator.rpartition("_")[2]
    if "Binary" in operator:
        return (before in BITS) == (after in BITS)
    if "Comparison" in operator:
        return not {"Is", "IsNot"} & {before, after} or {before, after} == {"Is", "IsNot"}
    return after != "Invert" or "Delete" in operator


def mutants_of(path: str) -> list[tuple[tuple[int, int], list[tuple[str, int]]]]:
    """Return the places of a file, each with the operators and occurrences that change it."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator, operator_names

    source = (ROOT / path).read_text(encoding="utf-8")
    left = [
        ((node.lineno, node.col_offset - 1), (node.end_lineno or 0, node.end_col_offset or 0))
        for node in spared(parsed(path))
        if hasattr(node, "lineno")
    ]
    dull = ("name", "string", "newline", "fstring_string", "endmarker")
    nodes = [node for node in ast_nodes(get_ast(source)) if node.type not in dull]
    found: dict[tuple[int, int], list[tuple[str, int]]] = collections.defaultdict(list)
    alike = collections.defaultdict(list)  # operators that change the same places: +_- and +_*
    for name in filter(wanted, operator_names()):
        if not get_operator(name).arguments():
            alike[name if "Delete" in name else name.rpartition("_")[0] or name].append(name)
    for names in alike.values():
        operator = get_operator(names[0])()
        positions = [start for node in nodes for start, _ in operator.mutation_positions(node)]
        for occurrence, start in enumerate(positions):
            if not any(begin <= start <= end for begin, end in left):
                found[start] += [(name, occurrence) for name in names]
    return sorted(found.items())


def draw(seed: int, number: int, rooms: list[str]) -> None:
    """Print a random sample of mutants."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    files = (path for room in rooms for path in (ROOT / "mavhums" / room).rglob("*.py"))
    paths = sorted(str(path.relative_to(ROOT)) for path in files)
    places = [(path, *place) for path in paths for place in mutants_of(path)]
    print(f"{len(places)} places in {len(paths)} modules", file=sys.stderr)
    chance = random.Random(seed)
    chance.shuffle(places)
    for path, _, variants in places:
        name, occurrence = chance.choice(variants)
        before = (ROOT / path).read_text(encoding="utf-8")
        after = mutate_code(before, get_operator(name)(), occurrence)
        try:
            if after is None or ast.dump(ast.parse(after)) == ast.dump(parsed(path)):
                continue
        except SyntaxError:
            continue
        old, new = before.splitlines(), after.splitlines()
        first = len(os.path.commonprefix([old, new]))  # noqa: RUF071
        tail = len(os.path.commonprefix([old[:first:-1], new[:first:-1]]))  # noqa: RUF071
        texts = ["\n".join(lines[first : len(lines) - tail]) for lines in (old, new)]
        print(json.dumps({"path": path, "line": first + 1, "old": texts[0], "new": texts[1]}), flush=True)
        number -= 1
        if not number:
            return


def located(mutant: dict[str, Any]) -> bool:
    """Let a mutant name the place where its text stands now: the module may be renamed since the sample."""
    old = mutant["old"].splitlines()

    def places(path: Path) -> list[int]:
        lines = [text for _, text in numbered(path)]
        return [i for i in range(1, len(lines) + 1) if lines[i - 1 : i - 1 + len(old)] == old]

    path = ROOT / mutant["path"]
    if path.exists() and (here := places(path)):
        mutant["line"] = min(here, key=lambda line: abs(line - mutant["line"]))
        return True
    others = [(other, line) for other in (ROOT / "mavhums").rglob("*.py") for line in places(other)]
    if len(others) == 1:
        mutant |= {"path": str(others[0][0].relative_to(ROOT)), "line": others[0][1]}
    return len(others) == 1


def start(mutant: dict[str, Any], tests: list[str], folder: str) -> int:
    """Run the tests on the mutant in a fork, which has loaded what does not change."""
    lines, at = [text for _, text in numbered(ROOT / mutant["path"])], mutant["line"] - 1
    lines[at : at + len(mutant["old"].splitlines())] = mutant["new"].splitlines()
    if pid := os.fork():
        return pid
    try:
        run("\n".join(lines) + "\n", mutant["path"], tests, folder)
    finally:
        traceback.print_exc()
        os._exit(99)


def run(text: str, path: str, tests: list[str], folder: str) -> None:
    """Run the tests with the text in place of the module, and exit."""
    os.setsid()
    limit = round(30 + 3 * sum(durations()[test] for test in tests))
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))  # of the processor: the machine may be busy
    with Path(f"{folder}/{os.getpid()}.log").open("w") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
    os.environ["MUTANT"] = f"{folder}/{os.getpid()}.py"
    os.environ["MUTANT_OF"] = path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    Path(os.environ["MUTANT"]).write_text(text, encoding="utf-8")
    exec(HOOK, {})
    import hypothesis
    import pytest

    quick: dict[str, Any] = {"deadline": None, "derandomize": True, "database": None}
    quick |= {"phases": (hypothesis.Phase.explicit, hypothesis.Phase.generate)}
    quick |= {"suppress_health_check": list(hypothesis.HealthCheck)}
    hypothesis.settings.register_profile("mutants", **quick)
    order = {test: i for i, test in enumerate(tests)}

    class Choice:
        def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
            names = {item: f"{item.nodeid.partition('::')[0]}::{item.name}" for item in items}
            items[:] = sorted((i for i in items if names[i] in order), key=lambda item: order[names[item]])

    options = [
        "-x",
        "-q",
        "-p",
        "no:cacheprovider",
        "--tb=line",
        "--assert=plain",
        "--hypothesis-profile=mutants",
    ]
    files = sorted({test.partition("::")[0] for test in tests})
    os._exit(int(pytest.main([*options, f"--rootdir={ROOT}", *files], plugins=[Choice()])))


def judge(mutants: list[dict[str, Any]], jobs: int = 2) -> None:
    """Print each mutant with its verdict: killed, survived, timeout, or untested."""
    os.chdir(ROOT)
    sys.path[:0] = [str(ROOT), str(ROOT / "sim")]
    for name in LOADED:
        importlib.import_module(name)
    waiting, running = collections.deque(mutants), {}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "sitecustomize.py").write_text(HOOK)
        os.environ.update(PYTHONPATH=f"{folder}:{ROOT}:{ROOT / 'sim'}", PYTHONDONTWRITEBYTECODE="1")
        while waiting or running:
            while waiting and len(running) < jobs:
                mutant = waiting.popleft()
                blank = len(mutant["old"]) - len(mutant["old"].lstrip("\n"))
                found = located(mutant)
                tests = chosen(mutant["path"], mutant["line"] + blank) if found else []
                mutant |= {"tests": len(tests), "verdict": "untested" if found else "gone", "s": 0.0}
                if tests:
                    running[start(mutant, tests, folder)] = mutant, time.monotonic()
                else:
                    print(json.dumps(mutant), flush=True)
            time.sleep(0.05)
            for pid, (mutant, since) in list(running.items()):
                ended, status = os.waitpid(pid, os.WNOHANG)
                took = time.monotonic() - since
                if not ended and took < MOST_WALL_S:
                    continue
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(pid, signal.SIGKILL)
                if not ended:
                    os.waitpid(pid, 0)
                code = os.waitstatus_to_exitcode(status) if ended else -1
                named = {0: "survived", 1: "killed", 2: "killed", 4: "killed"}
                mutant["verdict"] = named.get(code, "timeout" if code < 0 else f"error {code}")
                log = Path(f"{folder}/{pid}.log").read_text(errors="replace")
                by = re.findall(r"^(?:FAILED|ERROR) (\S+)", log, re.MULTILINE)
                mutant |= {"s": round(took, 1), "by": by[0] if by else log[-300:] if code > 0 else ""}
                del running[pid]
                print(json.dumps(mutant), flush=True)


def table(mutants: list[dict[str, Any]]) -> None:
    """Print the verdicts by room, with Wilson's 95 % interval of the share that survives."""
    from scipy.stats import binomtest

    for room in (*ROOMS, "all"):
        mine = [mutant for mutant in mutants if room in (mutant["path"].split("/")[1], "all")]
        counts = collections.Counter(mutant["verdict"] for mutant in mine)
        n, alive = len(mine) - counts["gone"], counts["survived"] + counts["untested"]
        if n:
            low, high = binomtest(alive, n).proportion_ci(method="wilson")
            print(f"{room:8} {n:4} {dict(counts)}: {alive / n:.1%} survive ({low:.1%} to {high:.1%})")


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["map", *folders]:
            make_map(folders)
        case ["sample", seed, number, *rooms]:
            draw(int(seed), int(number), rooms or list(ROOMS))
        case ["judge", file, *jobs]:
            judge([json.loads(line) for line in Path(file).read_text().splitlines()], *map(int, jobs))
        case ["table", file]:
            table([json.loads(line) for line in Path(file).read_text().splitlines()])
        case _:
            print(__doc__)
