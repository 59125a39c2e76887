"""Each benchmark runs with small numbers, and each command of the documents names what exists."""

from __future__ import annotations

import argparse
import importlib
import itertools
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import click
import pytest
from scipy.stats import binomtest

from benchmarks.trend import normal
from tests.conftest import CARRIED, REAL_LOGS
from tests.serve.browser import BROWSER

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", ROOT / "bridge" / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
COMMAND = re.compile(r"python (?:-m )?benchmarks[./](\w+)(?:\.py)?([^`]*)`")
PLACEHOLDERS = {"A": "1", "N": "1", "SECTION": "friction"}
NAMES = {path.stem for path in (ROOT / "benchmarks").glob("[a-z]*.py")}
ACTUATORS, LINKS = REAL_LOGS.with_name("actuators"), REAL_LOGS.parent / "flights" / "links"
RESPONSES = ("elevator_frozen.tlog", "healthy.tlog")


class Small(NamedTuple):
    """A small run: its arguments, constants of the module that it makes smaller, and what it needs."""

    arguments: str = ""
    constants: dict[str, Any] = {}
    slow: bool = False
    needs: Path | str | None = ROOT


RUNS: dict[str, list[Small]] = {
    "alfa": [Small("FLIGHTS", slow=True), Small("FLIGHTS --radio 1", slow=True)],
    "bridge": [Small()],
    "conditions": [Small(constants={"SEEDS": range(20, 22), "CLEAR": {"friction": 0.4}}, slow=True)],
    "control": [Small("--healthy-hours 0.1 --share 0 --jobs 1", slow=True)],
    "control_history": [Small("--aircraft 1 --flights 1 --tests 1 --jobs 1 --fault none", slow=True)],
    "damaged": [Small("--count 1", slow=True)],
    "decode": [
        Small(f"--format {name} --megabytes 1 --large 1 --repeat 1", {"STATES": ()}, slow=True)
        for name in ("tlog", "dataflash", "ulog")
    ],
    "false_alarms": [Small("--hours 0.01", {"_FLIGHT_S": 30.0})],
    "fleet": [Small("landings", {"LANDINGS": (10,)})],
    "fleet_equality": [Small("--flights 1", {"AIRCRAFT": 4, "TWO_VEHICLES": (3,)}, slow=True)],
    "fleet_year": [Small("--aircraft 1 --days 7", slow=True)],
    "growth": [Small("--histories 1 --every 50", slow=True)],
    "health": [
        Small("friction --scale 0.001 --workers 1"),
        Small("flights --scale 0.016 --workers 1", slow=True),
    ],
    "holes": [Small("--every 100 LOG")],
    "house": [Small(slow=True)],
    "links": [Small("LINKS", slow=True, needs=LINKS)],
    "live": [Small("--only share --seconds 15", slow=True)],
    "load_friction": [
        Small("--seconds 10 --only sheet", {"TELEMETRY": {"sensors": None}, "PROFILES": {"0": ""}}, slow=True)
    ],
    "motors": [Small("--faults 0 --hours 0.1")],
    "networks": [Small("--flights 1 --part modes", slow=True)],
    "own_history": [
        Small(
            "--aircraft 1 --each 1 --healthy 1 --sheet 0 --identify 0 --only motor",
            {"FLIGHTS_BEFORE": 6, "BASELINES": (5,), "FRICTIONS": (0.1,), "OTHERS": {"resistance": 0.2}},
            slow=True,
        )
    ],
    "own_supply": [Small(constants={"_BASELINE": 1, "LOST_V": (0.0,)}, slow=True)],
    "page": [Small(constants={"DROPS": 1, "TWENTY": 1}, slow=True, needs=BROWSER)],
    "perturbed": [Small("FLIGHTS --kinds cut --seeds 0-0 --jobs 1", {"_BEGINNINGS": 2}, slow=True)],
    "promised": [Small("--draws 1")],
    "real_actuators": [
        Small("ACTUATORS --only sheet --reps 0 --kinds sensor --workers 1", slow=True, needs=ACTUATORS)
    ],
    "record": [Small(constants={"CASES": {}})],
    "resemblance": [Small("--flights 1", slow=True)],
    "response_history": [Small("FLIGHTS")],
    "severities": [Small("friction --seeds 1 --seconds 20 --workers 1", {"STEPS": 2})],
    "simulate": [Small("--quick", slow=True)],
    "stall": [Small("--aircraft 1", slow=True)],
    "start": [Small(constants={"TIMES": 1, "PARTS": {"numpy": "import numpy"}}, slow=True)],
    "steering": [Small("--drives 1 --hours 0.1")],
    "tiers": [Small(constants={"RATES_HZ": (25.0,), "PAPER_FRICTION_NM": (0.225,)}, slow=True)],
    "train": [Small("--quick --part fifty --solver lbfgs --inputs 4", slow=True)],
    "trend": [Small("--quick", {"TAILS": {"normal": normal}, "FLIGHTS": (20,)}, slow=True)],
    "worn": [Small(constants={"CASES": (("none", 0.0),)}, slow=True)],
}


def test_each_benchmark_has_a_small_run() -> None:
    assert set(RUNS) == NAMES


@pytest.mark.parametrize(
    ("name", "small"),
    [
        pytest.param(name, small, id=f"{name} {small.arguments}", marks=[pytest.mark.slow] * small.slow)
        for name, several in RUNS.items()
        for small in several
    ],
)
def test_a_benchmark_runs(
    name: str,
    small: Small,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if small.needs is None or not Path(small.needs).exists():
        pytest.skip(f"needs {small.needs or 'Chromium'}")
    (tmp_path / "labels.csv").write_text(
        "file,kind,surface,servos,t_fault_boot_s,t_clear_boot_s,t_end_boot_s\n"
        "elevator_frozen.tlog,frozen,elevator,elevator(SERVO2),30,,60\nhealthy.tlog,none,none,,,,\n"
    )
    for file in RESPONSES:
        (tmp_path / file).symlink_to(CARRIED / file)
    places = {
        "FLIGHTS": tmp_path,
        "LINKS": LINKS,
        "LOG": CARRIED / "friction.BIN",
        "ACTUATORS": ACTUATORS,
    }
    module = importlib.import_module(f"benchmarks.{name}")
    for constant, value in small.constants.items():
        monkeypatch.setattr(module, constant, value)
    arguments = [str(places.get(one, one)) for one in small.arguments.split()]
    monkeypatch.setattr(sys, "argv", [str(module.__file__), *arguments])
    try:
        ended = module.main()
    except SystemExit as end:
        ended = end.code
    assert not ended
    printed = capsys.readouterr().out
    assert printed
    for head, rows in tables(printed).items():
        for cells in rows & EVIDENCE.get(head, {}).keys():
            alike(head, rows[cells], EVIDENCE[head][cells])


def tables(text: str) -> dict[str, dict[tuple[str, ...], list[str]]]:
    """Return the rows of each Markdown table by its head, each by its cells before the first count."""
    found: dict[str, dict[tuple[str, ...], list[str]]] = {}
    head = ""
    for before, line in itertools.pairwise(text.splitlines()):
        if re.fullmatch(r"(\|---)+\|", line):
            head = before
        elif head and line.startswith("| "):
            cells = line.strip("| ").split(" | ")
            labels = tuple(itertools.takewhile(lambda cell: not cell.isdecimal(), cells))
            found.setdefault(head, {})[labels] = cells
        else:
            head = ""
    return found


EVIDENCE = {
    head: rows
    for document in (ROOT / "docs" / "evidence").glob("*.md")
    for head, rows in tables(document.read_text(encoding="utf-8")).items()
}


def alike(head: str, found: list[str], said: list[str]) -> None:
    """Check a row of few flights against that of the evidence: no count may be surprising."""
    assert len(found) == len(said)
    counts = [
        (name, int(a), int(b))
        for name, a, b in zip(head.strip("| ").split(" | "), found, said, strict=True)
        if a.isdecimal() and b.isdecimal()
    ]
    (total, few, many), *others = counts
    if total not in {"actuator-flights", "actuators", "found of"}:
        return
    for name, found_of, said_of in others:
        # The evidence's own share is an estimate.
        share = (said_of + 1) / (many + 2)
        assert binomtest(found_of, few, share).pvalue > 0.001, (name, found, said)


class ParsedError(Exception):
    """The arguments are parsed: what follows is not run."""


def shown(document: Path) -> list[tuple[str, list[str]]]:
    """Return the benchmarks that a document shows, with their arguments."""
    found = COMMAND.findall(document.read_text(encoding="utf-8"))
    return [(name, [PLACEHOLDERS.get(one, one) for one in shlex.split(rest)]) for name, rest in found]


def parse(name: str, arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Parse arguments as the benchmark does; it exits where one does not exist."""

    def stop(parser: argparse.ArgumentParser) -> None:
        original(parser, arguments)
        raise ParsedError

    original = argparse.ArgumentParser.parse_args
    module = importlib.import_module(f"benchmarks.{name}")
    if isinstance(module.main, click.Command):
        module.main.make_context(name, arguments)
    elif hasattr(module, "argparse"):
        monkeypatch.setattr(argparse.ArgumentParser, "parse_args", stop)
        with pytest.raises(ParsedError):
            module.main()
        monkeypatch.undo()
    else:
        assert not arguments


@pytest.mark.slow
def test_each_command_of_the_documents_is_one_that_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    commands = [command for document in DOCUMENTS for command in shown(document)]
    assert len(commands) > 40
    for name, arguments in commands:
        assert name in NAMES, name
        parse(name, arguments, monkeypatch)
    with pytest.raises(SystemExit):
        parse("alfa", ["FOLDER", "--no-such-option"], monkeypatch)


def test_each_file_that_the_evidence_names_exists() -> None:
    for document in (ROOT / "docs" / "evidence").glob("*.md"):
        assert set(re.findall(r"`([a-z_]+)\.py`", document.read_text(encoding="utf-8"))) <= NAMES


def test_the_house_says_that_the_linter_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    missing = [sys.executable, "-c", "import sys; sys.exit('No module named ruff')"]
    done = subprocess.run(missing, capture_output=True, text=True, check=False)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)
    with pytest.raises(SystemExit, match=r"No module named ruff: .* pip install 'mavhums\[lint\]'"):
        list(importlib.import_module("benchmarks.house").long_signatures())
