"""How long the answers are: ``python benchmarks/answers.py FOLDER...``.

Judges every log in the folders, each alone, and counts the lines, at 100 columns, and the words of its
answer, brief and whole: of all logs, of those without a fault, and of those in which all is judged and well.
"""

from __future__ import annotations

import argparse
import io
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import median

from rich.console import Console

import mavhums
from mavhums.core.conditions import SEVERITY
from mavhums.core.errors import MavhumsError
from mavhums.results.assessment import Assessment
from mavhums.show import terminal

KINDS = {".tlog", ".bin", ".ulg"}
WELL = {"normal", "unchanged", "unmonitored"}


def answer(assessment: Assessment, *, verbose: bool) -> str:
    out = io.StringIO()
    terminal.render(assessment, Console(file=out, width=100, color_system=None), verbose=verbose)
    return out.getvalue().rstrip()


def line(name: str, answers: Sequence[str], most: int) -> str:
    lines, words = [text.count("\n") + 1 for text in answers], [len(text.split()) for text in answers]
    above = sum(count > most for count in lines)
    lengths = f"{median(lines):g} / {max(lines)} | {above} | {median(words):g} / {max(words)}"
    return f"| {name} | {len(answers)} | {lengths} |"


def judged(folders: Iterable[Path]) -> list[Assessment]:
    assessments = []
    for log in sorted(
        path for folder in folders for path in folder.rglob("*") if path.suffix.lower() in KINDS
    ):
        try:
            assessments.append(mavhums.analyse(log))
        except MavhumsError as error:
            print(error, file=sys.stderr)
    return assessments


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path)
    every = judged(parser.parse_args().folders)
    without = [one for one in every if all(SEVERITY[v.gravest] <= SEVERITY["normal"] for v in one.verdicts)]
    well = [one for one in without if {v.gravest for v in one.verdicts} <= WELL]
    print("| answers | logs | lines, median / most | longer | words, median / most |\n|---|---|---|---|---|")
    for name, assessments, most in (
        ("brief", every, 24),
        ("without a fault", without, 12),
        ("well", well, 12),
    ):
        if assessments:
            print(line(name, [answer(one, verbose=False) for one in assessments], most))
    if every:
        print(line("whole", [answer(one, verbose=True) for one in every], 24))


if __name__ == "__main__":
    main()
