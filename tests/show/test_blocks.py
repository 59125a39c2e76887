"""One list of blocks: every renderer draws all that it says, and none adds a sentence of its own."""

from __future__ import annotations

import ast
import html
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import mavhums
from mavhums.engine.events import Notice
from mavhums.results.assessment import Assessment
from mavhums.show import html as html_report
from mavhums.show import markdown_report, terminal
from mavhums.show.answer import blocks
from mavhums.show.blocks import Anchor, Block, Cell, Finding, Headline, Listing, Mark, Note, TableBlock
from mavhums.show.curves import EvidenceCollector

FLIGHTS = Path(__file__).parents[1] / "data"
SENTENCE = re.compile(r"(?:[^\W\d_]{2,}[ ,;:]+){3,}[^\W\d_]{2,}")
"""Four words in a row."""


@pytest.fixture
def shown(assessment: Assessment) -> list[Block]:
    """Blocks of every kind that a text can carry: of a real flight, and of actuators with faults."""
    whole = mavhums.analyse(FLIGHTS / "healthy.tlog")
    whole = whole.model_copy(update={"verdicts": (*assessment.verdicts, *whole.verdicts)})
    gathered = EvidenceCollector()
    gathered.consume([Notice(1.0, 1, "ArduPlane V4.6.0")])
    found = blocks(whole, gathered=gathered)
    assert {type(block) for block in found} >= {Finding, Headline, Listing, Note, TableBlock}
    return found


def texts(block: Block) -> Iterator[str]:
    match block:
        case Headline(text, about=about):
            yield from (text, about)
        case Note(lines) | Listing(_, lines):
            yield from lines
        case Finding(title, _, why, todo, facts, table):
            yield from (title, *why, todo, *facts)
            yield from texts(table) if table else ()
        case TableBlock(title, columns, rows):
            yield title
            yield from (column.title for column in columns)
            yield from (text for row in rows for cell in row for text in of_cell(cell))


def of_cell(cell: Cell) -> Iterator[str]:
    for part in [cell] if isinstance(cell, str) else cell:
        yield part.text if isinstance(part, Mark | Anchor) else part


def flat(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.parametrize("renderer", ["terminal", "markdown", "html"])
def test_every_renderer_draws_all_that_the_blocks_say(shown: list[Block], renderer: str) -> None:
    if renderer == "terminal":
        drawn = terminal.plain(shown)
    elif renderer == "markdown":
        drawn = re.sub(r"\\(.)", r"\1", markdown_report.draw(shown))
    else:
        drawn = html.unescape(re.sub("<[^>]*>", "", html_report.draw(shown)))
    drawn = flat(drawn)
    missing = [text for block in shown for text in texts(block) if flat(text) not in drawn]
    assert not missing


def test_no_renderer_holds_a_sentence() -> None:
    for module in (terminal, markdown_report, html_report):
        nodes = [*ast.walk(ast.parse(inspect.getsource(module)))]
        comments = {node.value for node in nodes if isinstance(node, ast.Expr)}  # docstrings, too
        texts = [node for node in nodes if isinstance(node, ast.Constant) and node not in comments]
        words = [node.value for node in texts if isinstance(node.value, str)]
        assert not [text for text in words if SENTENCE.search(text)]
    for template in (Path(terminal.__file__).parent / "templates").glob("*.html"):
        markup = template.read_text(encoding="utf-8")
        words = re.split(r"<[^>]*>|{[{%].*?[%}]}", markup)
        assert not [text for text in words if SENTENCE.search(text)], template.name
