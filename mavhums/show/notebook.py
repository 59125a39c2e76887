"""What a notebook shows of a result: the document of its blocks, in a frame."""

from __future__ import annotations

from typing import Final

from mavhums.results.assessment import Assessment
from mavhums.results.standing import TrendReport
from mavhums.show.answer import blocks
from mavhums.show.html import document
from mavhums.show.trend import trend_blocks

_STYLE: Final = "width: 100%; height: 32rem; border: 0; resize: vertical"


def cell(result: Assessment | TrendReport) -> str:
    """Return a result as markup for a notebook's cell.

    The frame is sandboxed, and keeps the document's style and the notebook's apart.
    """
    from markupsafe import escape

    shown = blocks(result, brief=True) if isinstance(result, Assessment) else trend_blocks(result)
    return f'<iframe sandbox title="mavhums" style="{_STYLE}" srcdoc="{escape(document(shown))}"></iframe>'
