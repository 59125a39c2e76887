"""Draws blocks as Markdown: the report inside a recording, and an answer to publish."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import PurePath

from mavhums.core.output import printable
from mavhums.results.assessment import Assessment
from mavhums.show.answer import blocks
from mavhums.show.blocks import Anchor, Block, Cell, Finding, Headline, Listing, Mark, Note, TableBlock

_ACTIVE = re.compile(r"([\\`*\[\]<|])")


def markdown(assessment: Assessment) -> str:
    """Return the assessment as a report in Markdown, the result in its first line.

    Parameters
    ----------
    assessment
        The verdicts of one log.
    """
    return draw(blocks(assessment))


def anonymous(assessment: Assessment) -> Assessment:
    """Return an assessment to publish: of a path only the file's name, and no notice that names a board."""
    log = assessment.log
    boards = [flight.board for flight in log.flight if flight.board]
    update = {
        "path": _file_name(log.path),
        "copies": tuple(copy.model_copy(update={"log": _file_name(copy.log)}) for copy in log.copies),
        "notices": tuple(said for said in log.notices if not any(board in said for board in boards)),
    }
    return assessment.model_copy(update={"log": log.model_copy(update=update)})


def _file_name(path: str | None) -> str | None:
    return PurePath(path.replace("\\", "/")).name if path else None


def draw(shown: Iterable[Block]) -> str:
    """Return blocks as Markdown; curves and outlines are drawn beside it."""
    return "\n\n".join(part for block in shown for part in _parts(block)) + "\n"


def _parts(block: Block) -> Iterator[str]:
    match block:
        case Headline(text, about=about, todo=todo):
            yield f"# {_literal(f'{block.mark.text}: {text}' if block.mark else text)}"
            if todo:
                yield f"**What to do:** {_literal(todo)}."
            if about:
                yield f"*{_literal(about)}*"
        case Note(lines, quiet):
            for line in lines:
                yield f"*{_literal(line)}*" if quiet else _literal(line)
        case Listing(title, lines):
            yield f"## {_literal(title)}"
            yield _list(lines)
        case TableBlock():
            if block.title:
                yield f"## {_literal(block.title)}"
            if block.rows:
                yield _table(block)
        case Finding():
            yield from _finding(block)


def _finding(found: Finding) -> Iterator[str]:
    yield f"## {_literal(f'{found.title}: {found.condition}')}"
    if found.todo:
        yield f"**What to do:** {_literal(found.todo)}."
    if found.why:
        only = len(found.why) == 1
        yield f"**Why:** {_literal(found.why[0])}." if only else f"**Why:**\n\n{_list(found.why)}"
    if found.facts:
        yield _list(found.facts)
    if found.table:
        yield _table(found.table)


def _list(lines: Iterable[str]) -> str:
    return "\n".join(f"- {_literal(line)}" for line in lines)


def _table(shown: TableBlock) -> str:
    head = [column.title.replace("\n", " ") for column in shown.columns]
    rows = [head, ["---"] * len(head), *([_cell(cell) for cell in row] for row in shown.rows)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _cell(cell: Cell) -> str:
    parts: Sequence[str | Mark | Anchor] = [cell] if isinstance(cell, str) else cell
    return "".join(
        _mark(part) if isinstance(part, Mark) else _literal(part if isinstance(part, str) else part.text)
        for part in parts
    )


def _mark(mark: Mark) -> str:
    return mark.text if mark.condition == "normal" else f"**{mark.text}**"


def _literal(text: str) -> str:
    """Return an external text on one line, with Markdown characters escaped."""
    return _ACTIVE.sub(r"\\\1", printable(text))
