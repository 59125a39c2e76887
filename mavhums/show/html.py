"""Draws blocks as HTML without scripts: for a browser without a network, a phone, paper, a notebook."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from itertools import groupby
from typing import TYPE_CHECKING, Any, Final

from mavhums.core.output import printable
from mavhums.results.assessment import Assessment
from mavhums.show.answer import blocks
from mavhums.show.blocks import Block, Curves, Headline, Note
from mavhums.show.curves import EvidenceCollector
from mavhums.show.html_plot import flight_charts, plot
from mavhums.show.words import COLOURS, SIGNS, clock

if TYPE_CHECKING:
    from jinja2 import Environment

    from mavhums.results.standing import TrendReport

_LETTERS: Final = 600
_FRAME: Final = "width: 100%; height: 32rem; border: 0; resize: vertical"


@cache
def environment(package: str) -> Environment:
    """Return the environment of a package's templates, which may include those of ``mavhums.show``.

    Parameters
    ----------
    package
        Import name of a package with a folder ``templates``.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    folders = dict.fromkeys((package, "mavhums.show"))
    made = Environment(
        loader=ChoiceLoader([PackageLoader(folder) for folder in folders]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_plain,
    )
    made.filters |= {"clock": clock, "plot": plot}
    made.globals |= {"icons": SIGNS, "colours": COLOURS}
    return made


def _plain(value: object) -> object:
    """Return a text without control characters and of bounded length."""
    if type(value) is not str:
        return value
    text = printable(value)
    return text if len(text) <= _LETTERS else f"{text[:_LETTERS]}…"


def draw(shown: Iterable[Block], heading: str = "h1") -> str:
    """Return blocks as markup in which every text is escaped.

    Parameters
    ----------
    shown
        The blocks.
    heading
        Tag of a headline.
    """
    runs = [(kind.__name__, [*several]) for kind, several in groupby(shown, type)]
    return environment("mavhums.show").get_template("_blocks.html").render(runs=runs, heading=heading)


def document(shown: Iterable[Block]) -> str:
    """Return blocks as one HTML document, complete in itself.

    Control characters are replaced. The document carries no script, and its content security policy forbids
    any and every address.
    """
    from markupsafe import Markup

    kept = [*shown]
    headline = next(block for block in kept if isinstance(block, Headline))
    text = f"{headline.mark.text}: {headline.text}" if headline.mark else headline.text
    title = " · ".join(filter(None, (text, headline.about.partition(" · ")[0])))
    template = environment("mavhums.show").get_template("report.html")
    return template.render(title=title, content=Markup(draw(kept)))


def page(assessment: Assessment, gathered: EvidenceCollector) -> str:
    """Return the assessment as one HTML document.

    Parameters
    ----------
    assessment
        The verdicts of one log.
    gathered
        What the engine reported of the same log.

    Examples
    --------
    >>> import mavhums
    >>> text = page(mavhums.analyse("flight.tlog"), EvidenceCollector())
    >>> "<h1" in text, "<script" in text
    (True, False)
    """
    return document(blocks(assessment, gathered=gathered))


def parts(assessment: Assessment, gathered: EvidenceCollector, heading: str = "h2") -> dict[str, Any]:
    """Return the assessment in parts for a page that draws the curves itself.

    Parameters
    ----------
    assessment, gathered
        As for :func:`page`.
    heading
        Tag of the headline.

    Returns
    -------
    dict
        ``answer`` and ``rest``, markup in which every text is escaped, and ``curves``, as
        :func:`mavhums.show.html_plot.flight_charts` returns them.
    """
    shown = blocks(assessment, gathered=gathered)
    curves = [one for block in shown if isinstance(block, Curves) for one in block.curves]
    kept = [block for block in shown if not isinstance(block, Curves)]
    first = next(k for k, block in enumerate(kept) if not isinstance(block, Headline | Note))
    return {
        "answer": draw(kept[:first], heading),
        "curves": flight_charts(curves, assessment.log.duration_s),
        "rest": draw(kept[first:]),
    }


def cell(result: Assessment | TrendReport) -> str:
    """Return a result as markup for a notebook's cell.

    The frame is sandboxed, and keeps the document's style and the notebook's apart.
    """
    from markupsafe import escape

    from mavhums.show.trend import short_blocks

    shown = escape(document(short_blocks(result)))
    return f'<iframe sandbox title="mavhums" style="{_FRAME}" srcdoc="{shown}"></iframe>'
