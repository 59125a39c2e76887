"""Tables of docs/evidence, and whether a small run of the command that prints one agrees with it."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import NamedTuple

from scipy.stats import binomtest

PAGES = Path(__file__).parents[1] / "docs" / "evidence"
NUMBER = r"[+-]?\d+(?:\.\d+)?"
SURPRISE = 0.001  # the probability below which a count of a small run contradicts the page
SHARES = 100  # trials that a share of the page counts for
SPREADS = 4.0  # standard deviations of single values between the means of two runs

Table = dict[tuple[str, ...], dict[str, str]]
"""Rows by their labels, each with its cells by column."""


class Cells(NamedTuple):
    """How the cells of a table are read: what a row's labels are, and how far a small run may be off.

    Attributes
    ----------
    labels
        Leading columns that name a row.
    of
        Independent trials behind a share: their number in the small run, or the column that says it. With 0
        percentages are sizes.
    each
        Cases in a count that are no independent trials, as the windows of a flight.
    factor
        By which figures that are neither counts nor shares may differ.
    without
        Columns of times and memory, which differ by machine, and of what a small run does not measure.
    """

    labels: int = 1
    of: int | str = 0
    each: int = 1
    factor: float = 2.0
    without: tuple[str, ...] = ()


def tables(text: str) -> dict[str, list[list[str]]]:
    """Return the rows of each Markdown table by its head."""
    found: dict[str, list[list[str]]] = {}
    head = ""
    for before, line in itertools.pairwise(text.splitlines()):
        if re.fullmatch(r"(\|---)+\|", line):
            head = before
            found[head] = []
        elif head and line.startswith("|"):
            found[head].append(split(line))
        else:
            head = ""
    return found


def split(line: str) -> list[str]:
    """Return the cells of a row."""
    return [cell.strip().strip("*").replace(" %", "%") for cell in line.strip()[1:-1].split("|")]


def rows(head: str, cells: list[list[str]], labels: int) -> Table:
    """Return the rows of a table by their labels."""
    columns = split(head)
    return {
        tuple(plain(cell) for cell in row[:labels]): dict(zip(columns[labels:], row[labels:], strict=True))
        for row in cells
    }


def plain(cell: str) -> str:
    """Return a cell without what is in brackets, with one minus."""
    return re.sub(r"\s*\([^)]*\)", "", cell).replace("−", "-").replace("≤ ", "").strip()


def said() -> dict[str, list[list[str]]]:
    """Return the tables of all pages of the evidence."""
    return {
        head: body
        for page in sorted(PAGES.glob("*.md"))
        for head, body in tables(page.read_text(encoding="utf-8")).items()
    }


def compare(printed: str, head: str, cells: Cells) -> int:
    """Compare a command's table with the page's of this head; return how many cells were compared.

    A small run may print fewer columns and rows, but none that the page lacks.
    """
    known = rows(head, said()[head], cells.labels)
    columns = split(head)
    compared = 0
    for own, body in tables(printed).items():
        titles = split(own)
        if titles[: cells.labels] != columns[: cells.labels] or not {*titles} <= {*columns}:
            continue
        for labels, row in rows(own, body, cells.labels).items():
            page = known.get(labels, {})
            few, many = (
                (cells.of, SHARES) if isinstance(cells.of, int) else (row[cells.of], page.get(cells.of, 0))
            )
            for column, cell in row.items():
                if page and column not in (cells.of, *cells.without) and cell not in "–—":
                    where = f"{labels}, {column}: found {cell}, the page says {page[column]}"
                    trials = (int(few), int(many)) if few else (0, 0)
                    agree(plain(cell), plain(page[column]), trials, cells, where)
                    compared += 1
    return compared


def agree(found: str, expected: str, trials: tuple[int, int], cells: Cells, where: str) -> None:
    """Check one cell: no count or share may be surprising, and no figure far off."""
    for mine, page in zip(found.split("; "), expected.split("; "), strict=False):  # no median of nothing
        own, theirs = counts(mine, trials[0]), counts(page, trials[1])
        for name, (count, of) in own.items():
            few, many = theirs.get(name, (0, sum(n for n, _ in theirs.values())))
            n = max(round(of / cells.each), 1)
            pvalue = binomtest(min(round(count / cells.each), n), n, (few + 1) / (many + 2)).pvalue
            assert pvalue > SURPRISE, where
        if not own:
            near(mine, page, cells.factor, where)


def near(found: str, expected: str, factor: float, where: str) -> None:
    """Check figures: a mean by the scatter of single values, others by a factor or the last digit shown."""
    own, page = ([float(number) for number in re.findall(NUMBER, text)] for text in (found, expected))
    assert len(own) == len(page), where
    assert own or found == expected, where
    digit = 10.0 ** -max((len(digits) for digits in re.findall(r"\.(\d+)", expected)), default=0)
    if "±" in expected:
        assert abs(own[0] - page[0]) <= SPREADS * page[1] + digit, where
        assert own[1] <= 3 * page[1] + digit, where
        return
    for x, y in zip(own, page, strict=True):
        assert abs(x - y) <= digit or (x * y > 0 and 1 / factor <= x / y <= factor), where


def counts(text: str, trials: int) -> dict[str, tuple[float, int]]:
    """Return the counts of a text, each with what it is of; none of other figures."""
    if "±" in text:
        return {}
    if hours := re.fullmatch(r"([\d /]+) in (\d+) h", text):
        return {str(k): (float(n), max(int(hours[2]), 1)) for k, n in enumerate(hours[1].split(" / "))}
    if whole := re.fullmatch(r"([\d, ]+)(?:of |/)(\d+)\D*", text):
        return {str(k): (float(n), int(whole[2])) for k, n in enumerate(whole[1].split(", "))}
    if text.endswith("%") and trials:
        shares = re.findall(NUMBER, text)
        return {str(k): (float(share) / 100 * trials, trials) for k, share in enumerate(shares)}
    if named := re.fullmatch(r"\d+ [a-z ]+(, \d+ [a-z ]+)*", text):
        several = {name: int(n) for n, name in re.findall(r"(\d+) ([a-z ]+)", named[0])}
        return {name: (n, sum(several.values())) for name, n in several.items()}
    if text.isdecimal() and trials:
        return {"": (float(text), trials)}
    return {}
