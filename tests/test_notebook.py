"""The notebook runs from its first cell to its last, shows results as reports, and carries no outputs."""

from __future__ import annotations

import ast
import json
import warnings
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

import mavhums
from mavhums.results.assessment import Assessment
from mavhums.results.standing import TrendReport
from tests.conftest import CARRIED

NOTEBOOK = Path(__file__).parents[1] / "examples" / "notebook.ipynb"


def shown_by(cells: list[dict[str, Any]]) -> Iterator[Any]:
    """Run cells as a kernel does, and yield the value of the expression that ends each."""
    names: dict[str, Any] = {}
    for cell in cells:
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop()
        exec(compile(tree, NOTEBOOK.name, "exec"), names)
        if isinstance(last, ast.Expr):
            yield eval(compile(ast.Expression(last.value), NOTEBOOK.name, "eval"), names)
        else:
            exec(compile(ast.Module([last], []), NOTEBOOK.name, "exec"), names)


@pytest.mark.slow
def test_every_cell_runs() -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    cells = [one for one in json.loads(NOTEBOOK.read_text("utf-8"))["cells"] if one["cell_type"] == "code"]
    assert not [cell for cell in cells if cell["outputs"] or cell["execution_count"]]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of matplotlib's own
        values = [*shown_by(cells)]
    [assessment] = [value for value in values if isinstance(value, Assessment)]
    [report] = [value for value in values if isinstance(value, TrendReport)]
    assert assessment.ranked()[0].actuator == "elevator"
    assert report.flights == 4
    assert len(values) == len(cells) - 1  # each but the first shows something


class _Frames(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


def test_a_result_shows_itself_in_a_frame_of_its_own(tmp_path: Path) -> None:
    store = tmp_path / "flights.sqlite"
    assessment = mavhums.analyse(CARRIED / "aileron_frozen.tlog", store=store, keep=True)
    for result, words in ((assessment, "DEGRADED"), (mavhums.trend(store), "(1 flight)")):
        [(tag, attributes)] = _Frames(result._repr_html_()).tags
        assert (tag, attributes["sandbox"]) == ("iframe", None)  # no scripts, no forms
        content = attributes["srcdoc"] or ""
        assert words in content[content.index("<h1") :]
        assert "://" not in content
