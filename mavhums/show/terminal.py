"""Draws blocks on a terminal, in colours where it has them."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console, RenderableType
from rich.padding import Padding
from rich.table import Table as Grid
from rich.text import Text

from mavhums.core.conditions import SEVERITY
from mavhums.core.output import printable
from mavhums.results.assessment import Assessment
from mavhums.show.answer import blocks
from mavhums.show.blocks import Anchor, Block, Cell, Finding, Headline, Listing, Mark, Note, TableBlock
from mavhums.show.words import COLOURS, SIGNS

if TYPE_CHECKING:
    from mavhums.results.standing import TrendReport

_GAP = 2
_WIDE = 1_000_000


def render(assessment: Assessment, console: Console, *, verbose: bool = False) -> None:
    """Print an assessment for a person: what is wrong, or that nothing is, and what to do.

    Parameters
    ----------
    assessment
        The verdicts of one log.
    console
        Where to print; rich leaves the colours out where it is not a terminal.
    verbose
        Print every reason and finding, servo usage, and unmonitored servos, too.
    """
    draw(blocks(assessment, brief=not verbose), console)


def plain(shown: Iterable[Block]) -> str:
    """Return blocks as a text without colours, a line for each sentence however long."""
    file = io.StringIO()
    draw(shown, Console(file=file, width=_WIDE, color_system=None))
    return file.getvalue()


def summary(result: Assessment | TrendReport) -> str:
    """Return a result as a text without colours."""
    from mavhums.show.trend import short_blocks

    return plain(short_blocks(result))


def draw(shown: Iterable[Block], console: Console) -> None:
    """Print blocks, each in its way; curves and outlines are not for a terminal."""
    for part in parts(shown, console.width):
        console.print(part)


def parts(shown: Iterable[Block], width: int) -> Iterator[RenderableType]:
    """Yield what rich prints of blocks on a terminal of a width."""
    for block in shown:
        match block:
            case Headline(text, about=about, todo=todo):
                head = Text(printable(text), style="bold")
                yield Text.assemble(_mark(block.mark), ": ", head) if block.mark else head
                yield from (Text(printable(f"What to do: {line}.")) for line in (todo,) if line)
                yield from (Text(printable(line), style="dim") for line in (about,) if line)
            case Note(lines, quiet):
                yield from (Text(printable(line), style="dim" if quiet else "") for line in lines)
            case Listing(title, lines):
                yield Text(printable(title), style="bold")
                yield from map(_indented, lines)
            case Finding():
                yield from _finding(block, width)
            case TableBlock():
                yield from _table(block, width)


def _finding(found: Finding, width: int) -> Iterator[RenderableType]:
    why = [*found.why]
    # When a fault was seen, one by one; a single reason why nothing is known fits behind the name.
    is_fault = SEVERITY[found.condition] > SEVERITY["normal"]
    inline = f": {why.pop()}" if len(why) == 1 and not is_fault else ""
    yield Text.assemble((printable(f"{found.title}: {found.condition}"), "bold"), printable(inline))
    yield from map(_indented, (*why, *found.facts, *([f"what to do: {found.todo}"] if found.todo else [])))
    if found.table:
        yield from _table(found.table, width)


def _indented(line: str) -> Padding:
    """Return a line that is indented wherever it wraps, and by two more as it begins with blanks."""
    text = line.lstrip()
    return Padding(Text(printable(text)), (0, 0, 0, 2 + len(line) - len(text)), expand=False)


def _table(shown: TableBlock, width: int) -> Iterator[RenderableType]:
    """Yield a table with as many columns as the terminal is wide, those of the lowest rank."""
    if shown.title:
        yield Text(printable(shown.title), style="bold")
    if not shown.rows:
        return
    rows = [[_text(cell) for cell in row] for row in shown.rows]
    widths = [
        max(*map(len, column.title.splitlines()), *(len(row[k]) for row in rows)) + _GAP
        for k, column in enumerate(shown.columns)
    ]
    kept, used = [], 0
    for k in sorted(range(len(widths)), key=lambda k: shown.columns[k].rank):
        if not shown.columns[k].rank or used + widths[k] <= width:
            kept.append(k)
            used += widths[k]
    some_stay = any(column.kind != "text" for column in shown.columns)  # and would leave a name no room
    grid = Grid(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    for k in sorted(kept):
        column = shown.columns[k]
        grid.add_column(
            column.title,
            overflow="fold",
            justify="right" if column.kind == "figure" else "left",
            no_wrap=column.kind != "text",
            min_width=min(widths[0] - _GAP, width * 2 // 3) if k == 0 and some_stay else None,
        )
    for row in rows:
        grid.add_row(*(row[k] for k in sorted(kept)))
    yield Padding(grid, (0, 0, 0, 1), expand=False)


def _mark(mark: Mark) -> tuple[str, str]:
    style = "bold rgb({},{},{})".format(*COLOURS[mark.condition])
    return f"{SIGNS[mark.condition]} {mark.text}", style


def _text(cell: Cell) -> Text:
    if isinstance(cell, str):
        return Text(printable(cell))
    parts = [
        _mark(part) if isinstance(part, Mark) else printable(part.text if isinstance(part, Anchor) else part)
        for part in cell
    ]
    return Text.assemble(*parts)
