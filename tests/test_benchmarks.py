"""Each benchmark runs with small numbers, and each command of the documents names what exists."""

from __future__ import annotations

import argparse
import importlib
import re
import shlex
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import click
import pytest

from benchmarks.trend import normal
from tests.conftest import CARRIED, REAL_LOGS
from tests.evidence import Cells, agree, compare, plain, said
from tests.serve.browser import BROWSER

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", ROOT / "bridge" / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
COMMAND = re.compile(r"python (?:-m )?benchmarks[./](\w+)(?:\.py)?([^`]*)`")
PLACEHOLDERS = {"A": "1", "N": "1", "SECTION": "friction"}
NAMES = {path.stem for path in (ROOT / "benchmarks").glob("[a-z]*.py")}
ACTUATORS, LINKS = REAL_LOGS.with_name("actuators"), REAL_LOGS.parent / "flights" / "links"
RESPONSES = ("elevator_frozen.tlog", "healthy.tlog")


class Small(NamedTuple):
    """A small run: its arguments, constants of the module that it makes smaller, and what it needs.

    ``compares`` has the tables of the evidence that it prints, by the beginning of their heads.
    """

    arguments: str = ""
    constants: dict[str, Any] = {}
    compares: dict[str, Cells] = {}
    slow: bool = True
    needs: Path | str | None = ROOT


SENSORS = {"TELEMETRY": {"sensors": None}}
SHEET = {"PROFILES": {"0.0": "load_friction = 0.0"}, "PAPER_FRICTION_NM": (0.225, 1.025)}
OWN = {"FLIGHTS_BEFORE": 20, "FRICTIONS": (0.02, 0.2), "OTHERS": {"torque_constant": 0.15}}
BASELINES = {"_against_baseline.RATES_HZ": (100.0,), "_against_baseline.CLEAR": {"resistance": 0.15}}
WINDOWS, ALARMS = ("windows answered",), ("alarms over promised",)  # columns that no small run measures
RUNS: dict[str, list[Small]] = {
    "alfa": [Small("FLIGHTS"), Small("FLIGHTS --radio 1")],
    "answers": [Small("FLIGHTS", slow=False)],
    "bridge": [Small(slow=False)],
    "conditions": [Small("", {"CLEAR": {"supply_sag": 6.0}}, {"| condition, unit": Cells(factor=1.1)})],
    "control": [Small("--no-airspeed --healthy-hours 0.1 --share 40 --only mixed --jobs 1")],
    "control_history": [Small("--aircraft 1 --flights 1 --tests 1 --jobs 1 --fault none")],
    "damaged": [Small("--count 1")],
    "decode": [
        Small(f"--format {name} --megabytes 1 --large 1 --repeat 1", {"STATES": ()})
        for name in ("tlog", "dataflash", "ulog")
    ],
    "false_alarms": [Small("--hours 0.01", {"_FLIGHT_S": 30.0}, slow=False)],
    "fleet": [Small("stored", {"LANDINGS": (10,)})],
    "fleet_equality": [Small("--flights 1", {"AIRCRAFT": 4, "TWO_VEHICLES": (3,)})],
    "fleet_year": [Small("--aircraft 1 --days 7")],
    "growth": [
        Small(
            "--histories 3 --first 7000 --every 100",
            {"SCATTERS": (0.03,), "BEGINS": (0,)},
            {"| growth after": Cells(labels=2, of=3)},
            slow=False,
        )
    ],
    "health": [
        Small("friction --scale 0.067 --workers 1"),
        Small("flights --scale 0.016 --workers 1"),
        Small("jams --scale 0.1 --workers 1", {"_against_limits.MODES": ("takeoff",)}),
        Small("windows --scale 0.05 --workers 1", {"_against_limits.WINDOWS_HZ": (10.0,)}),
        Small(
            "early --scale 0.2 --workers 1",
            {"_against_baseline.EARLY": ((25.0, ("takeoff",), 0.0),)},
            {"| rate | modes | k_t drift": Cells(labels=3, of="of")},
        ),
        Small(
            "conditions --scale 0.2 --workers 1", BASELINES, {"| condition, clear severity": Cells(of="of")}
        ),
    ],
    "holes": [Small("--every 100 LOG", slow=False)],
    "house": [Small()],
    "links": [Small("LINKS", needs=LINKS)],
    "live": [Small("--only share --seconds 15")],
    "load_friction": [
        Small("--only sheet", SENSORS | SHEET),
        Small(
            "--only own --each 1",
            SENSORS | {"RISES": (0.0, 1.0), "BEFORE": 10},
            {"| read by | judged by": Cells(labels=2)},
        ),
    ],
    "motors": [
        Small(
            "--faults 1 --hours 0.1", {"LOSSES": (1.0, 0.3)}, {"| lost thrust": Cells(labels=2, factor=4.0)}
        )
    ],
    "networks": [
        Small("--part cards", {}, {"| network | inputs": Cells(labels=2, factor=1.01)}, slow=False),
        Small(
            "--flights 1 --part windows",
            {"_windows.CYCLOGRAMS_EACH": 3},
            {"| network | right of the decided, card": Cells(of=12, factor=4.0)},
        ),
        Small(
            "--flights 1 --part independent",
            {"EACH": 3},
            {"| | windows answered": Cells(of=6, each=45, without=WINDOWS)},
        ),
    ],
    "own_history": [
        Small(
            "--aircraft 1 --each 1 --healthy 1 --sheet 0 --identify 0 --only motor",
            OWN,
            {"| measured": Cells(labels=2, of=4), "| fault | motor": Cells(of=4)},
        ),
        Small(
            "--aircraft 0 --sheet 0 --identify 1", {"IDENTIFIED": ("esc-signed",), "IDENTIFIED_HZ": (25.0,)}
        ),
    ],
    "own_supply": [Small("", {"LOST_V": (24.0,), "NAMES": ("position, 50 Hz",)})],
    "page": [Small("", {"DROPS": 1, "TWENTY": 1}, needs=BROWSER)],
    "perturbed": [Small("FLIGHTS --kinds cut --seeds 0-0 --jobs 1", {"_BEGINNINGS": 2})],
    "promised": [
        Small(
            "--draws 10", {}, {"| between flights": Cells(labels=5, factor=1.5, without=ALARMS)}, slow=False
        )
    ],
    "real_actuators": [Small("ACTUATORS --only sheet --reps 0 --kinds sensor --workers 1", needs=ACTUATORS)],
    "record": [Small("", {"CASES": {}}, slow=False)],
    "resemblance": [Small("--flights 3", {}, {"| | closed loop": Cells()})],
    "severities": [Small("friction --seeds 1 --seconds 20 --workers 1", {"STEPS": 2}, slow=False)],
    "simulate": [Small("--quick")],
    "start": [Small("", {"TIMES": 1, "PARTS": {"numpy": "import numpy"}})],
    "steering": [
        Small("--drives 2 --hours 0.1", {}, {"| fault | vehicle": Cells(labels=2, factor=6.0)}, slow=False)
    ],
    "threshold_mutants": [
        Small("--only HORIZON_FLIGHTS", {"TESTS": ("tests/health/decision/test_growth.py",)})
    ],
    "sensors": [Small("LOG --only airspeed|gyro")],
    "thinned": [Small("LOG --only PARM|RCOU"), Small("LOG --beginnings", {"_BEGINNINGS": 2})],
    "tiers": [Small("", {"RATES_HZ": (25.0,), "PAPER_FRICTION_NM": (0.225,)})],
    "train": [Small("--quick --part fifty --solver lbfgs --inputs 4")],
    "trend": [Small("--quick", {"TAILS": {"normal": normal}})],
    "worn": [Small("", {"CASES": (("none", 0.0), ("jam", 10.0))})],
}


NOT_COMPARED = (
    # The logs or recordings are not in the repository, ...
    *("| | ArduPlane |", "| condition | friction both ways", "| split |"),
    # ... the smallest run that says anything takes minutes of processor time, ...
    "| the paper says",
    # ... or it has no figures.
    "| | simulated |",
)
"""Tables of the evidence that no small run compares, by the beginning of their heads, and why."""


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
    log = CARRIED / "friction.BIN"
    places = {"FLIGHTS": tmp_path, "LINKS": LINKS, "LOG": log, "ACTUATORS": ACTUATORS}
    module = importlib.import_module(f"benchmarks.{name}")
    for constant, value in small.constants.items():
        place, _, attribute = constant.rpartition(".")
        monkeypatch.setattr(importlib.import_module(f"benchmarks.{place or name}"), attribute, value)
    arguments = [str(places.get(one, one)) for one in small.arguments.split()]
    monkeypatch.setattr(sys, "argv", [str(module.__file__), *arguments])
    try:
        ended = module.main()
    except SystemExit as end:
        ended = end.code
    assert not ended
    printed = capsys.readouterr().out
    assert printed
    for beginning, cells in small.compares.items():
        assert compare(printed, head_of(beginning), cells), f"nothing of {beginning} is compared"


def head_of(beginning: str) -> str:
    """Return the one table of the evidence that begins so."""
    [head] = [head for head in said() if head.startswith(beginning)]
    return head


def test_each_table_of_the_evidence_is_compared_or_says_why_not() -> None:
    compared = {
        head_of(beginning) for several in RUNS.values() for small in several for beginning in small.compares
    }
    excepted = {head_of(beginning) for beginning in NOT_COMPARED}
    assert not compared & excepted
    assert {*said()} == compared | excepted


@pytest.mark.parametrize(
    ("found", "page", "of", "agrees"),
    [
        ("4 of 4; 0.33", "33 of 34; 0.32", 0, True),
        ("0 of 8", "33 of 34", 0, False),
        ("100 / 38 %", "100 / 40 %", 8, True),
        ("100 / 100 %", "100 / 9 %", 8, False),
        ("+0.004 ± 0.010", "−0.001 ± 0.009", 0, True),
        ("+0.104 ± 0.010", "−0.001 ± 0.009", 0, False),
        ("8 unchanged", "25 unchanged, 20 learning", 0, True),
        ("20 changed", "48 unchanged", 0, False),
        ("1.9", "1.0", 0, True),
        ("2.1", "1.0", 0, False),
        ("never", "16 (highest V4)", 0, False),
        ("0 / 0 in 9 h", "0 / 1 in 300 h", 0, True),
    ],
)
def test_a_cell_is_compared_as_what_it_is(found: str, page: str, of: int, agrees: bool) -> None:
    head = "| a | b |\n|---|---|\n"
    with nullcontext() if agrees else pytest.raises(AssertionError):
        agree(plain(found), plain(page), (of, 100 if of else 0), Cells(), head)


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
    assert len(commands) > 25
    for name, arguments in commands:
        assert name in NAMES, name
        parse(name, arguments, monkeypatch)
    with pytest.raises(SystemExit):
        parse("alfa", ["FOLDER", "--no-such-option"], monkeypatch)


def test_each_file_that_the_evidence_names_exists() -> None:
    for document in (ROOT / "docs" / "evidence").glob("*.md"):
        assert set(re.findall(r"`([a-z_]+)\.py`", document.read_text(encoding="utf-8"))) <= NAMES
