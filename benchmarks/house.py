"""The house in figures: size of its rooms, names with two meanings, long signatures, imports, words.

    python benchmarks/house.py

Lines of code are those without docstrings, blanks, comments and imports.
"""

from __future__ import annotations

import ast
import collections
import io
import json
import re
import subprocess
import sys
import tokenize
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "mavhums"
LOG = ROOT / "tests" / "data" / "elevator_frozen.tlog"
LIMIT = 6  # parameters of a function, as in pyproject.toml
BLANK = {tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
ANALYSE = """
import sys, mavhums
mavhums.analyse(sys.argv[1])
print(*sorted(name for name in sys.modules if name.partition(".")[0] == "mavhums"))
"""


def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def lines_and_comments(path: Path) -> tuple[int, int]:
    """Return the lines of code and the comments of a module."""
    skipped: set[int] = set()
    for node in ast.walk(tree(path)):
        match node:
            case ast.Import() | ast.ImportFrom():
                skipped.update(range(node.lineno, (node.end_lineno or 0) + 1))
            case ast.Module() | ast.ClassDef() | ast.FunctionDef() | ast.AsyncFunctionDef():
                if ast.get_docstring(node, clean=False) is not None:
                    first = node.body[0]
                    skipped.update(range(first.lineno, (first.end_lineno or 0) + 1))
    lines: set[int] = set()
    comments = 0
    for token in tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline):
        if token.type == tokenize.COMMENT:
            comments += 1
        elif token.type not in BLANK:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines - skipped), comments


def rooms() -> Iterator[str]:
    """Yield a line for each room, and one for all."""
    found: dict[str, list[tuple[int, int]]] = collections.defaultdict(list)
    for path in sorted(PACKAGE.rglob("*.py")):
        found[path.relative_to(PACKAGE).parts[0]].append(lines_and_comments(path))
    yield f"{'room':14} {'modules':>7} {'code':>7} {'comments per 1,000':>19}"
    for room, figures in (*found.items(), ("all", [one for part in found.values() for one in part])):
        code, comments = (sum(column) for column in zip(*figures, strict=True))
        yield f"{room:14} {len(figures):7} {code:7} {1000 * comments / max(code, 1):19.0f}"


def names_of_two_classes() -> Iterator[str]:
    found = collections.defaultdict(list)
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in tree(path).body:
            if isinstance(node, ast.ClassDef):
                found[node.name].append(str(path.relative_to(PACKAGE)))
    yield from (f"{name}: {', '.join(paths)}" for name, paths in sorted(found.items()) if len(paths) > 1)


def long_signatures() -> Iterator[str]:
    """Yield the public functions above the limit, also where pyproject.toml makes an exception."""
    command = [sys.executable, "-m", "ruff", "check", "--isolated", "--select=PLR0913", "--quiet"]
    command += ["--output-format=json", f"--config=lint.pylint.max-args={LIMIT}", str(PACKAGE)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if not done.stdout:  # it prints a list, if only an empty one, unless it cannot start
        sys.exit(f"{done.stderr.strip()}: signatures are not counted; pip install 'mavhums[lint]'")
    for found in json.loads(done.stdout):
        path, row = Path(found["filename"]), found["location"]["row"]
        name = path.read_text(encoding="utf-8").splitlines()[row - 1].split("def ")[-1].partition("(")[0]
        if not name.startswith("_") or name == "__init__":
            count = re.findall(r"\d+", found["message"])[0]
            yield f"{path.relative_to(PACKAGE)}:{row} {name}: {count}"


def names_of_messages() -> Iterator[str]:
    """Yield the files that name a message, outside of those that may; the test of formats has the rule."""
    from tests.vehicle import test_formats as rule

    for path in sorted(PACKAGE.rglob("*.py")):
        allowed = any(map(path.is_relative_to, rule.KNOWS))
        if not allowed and any(rule.NAME.search(text) for _, text in rule.texts(path)):
            yield str(path.relative_to(PACKAGE))


def imported(path: Path) -> Iterator[Path]:
    """Yield the modules of the package that a module imports, at its head or in a function."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == PACKAGE.name:
            place = ROOT.joinpath(*(node.module or "").split("."))
            names = [place / alias.name for alias in node.names]
            yield from filter(Path.is_file, (one.with_suffix(".py") for one in (place, *names)))
            yield from filter(Path.is_file, (one / "__init__.py" for one in (place, *names)))


def needed(roots: Iterable[Path], graph: Mapping[Path, set[Path]]) -> set[Path]:
    """Return the modules that some modules need, these included."""
    found, waiting = set[Path](), [*roots]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting += graph[path]
    return found


def of_one_command() -> Iterator[str]:
    """Yield how many lines the package has for one module of the command line, and for no other one."""
    graph = {path: {*imported(path)} for path in PACKAGE.rglob("*.py")}
    graph[PACKAGE / "__init__.py"] = graph[PACKAGE / "cli" / "main.py"] = set()  # they import all, lazily
    commands = sorted((PACKAGE / "cli").glob("*.py"))
    whole = needed(commands, graph)
    for command in commands:
        own = whole - needed((one for one in commands if one != command), graph)
        if len(own) > 1:
            yield f"{command.stem}: {sum(lines_and_comments(path)[0] for path in own)}"


def words(*patterns: str) -> int:
    paths = {path for pattern in patterns for path in ROOT.glob(pattern)}
    return sum(len(path.read_text(encoding="utf-8").split()) for path in paths)


def main() -> None:
    print(*rooms(), sep="\n")
    analyse = [sys.executable, "-c", ANALYSE, str(LOG)]
    modules = subprocess.run(analyse, capture_output=True, text=True, check=True, cwd=ROOT).stdout.split()
    print(f"\nmodules of mavhums after `analyse` of one log: {len(modules)}")
    print(f"words: README {words('README.md')}, docs {words('docs/**/*.md')}")
    for title, lines in (
        ("commands with lines that no other one needs", of_one_command()),
        ("class names of two modules", names_of_two_classes()),
        ("files that name a message", names_of_messages()),
        (f"public functions above {LIMIT} parameters", long_signatures()),
    ):
        found = [*lines]
        print(f"\n{title}: {len(found)}", *(f"  {line}" for line in found), sep="\n", flush=True)


if __name__ == "__main__":
    main()
