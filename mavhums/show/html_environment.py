"""The templates' environment: every text is escaped, bounded and free of control characters."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Final

from mavhums.core.conditions import Condition
from mavhums.show.words import COLOURS, clock, printable

if TYPE_CHECKING:
    from jinja2 import Environment

__all__ = ["ICONS", "environment", "moment"]

ICONS: Final[dict[Condition, str]] = {
    "normal": "✓",
    "unchanged": "=",
    "changed": "≠",
    "degraded": "▲",
    "emergency": "✖",
    "learning": "…",
    "undecided": "?",
    "unmonitored": "○",
}
"""A sign per condition, so that no reader depends on its colour."""


_LETTERS: Final = 600


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
    made.filters |= {"clock": clock, "moment": moment}
    made.globals |= {"icons": ICONS, "colours": COLOURS}
    return made


def moment(utc: str) -> str:
    """Return a time as a reader writes it.

    Examples
    --------
    >>> moment("2026-01-01T09:01:07.003611+00:00")
    '2026-01-01 09:01:07 UTC'
    """
    return f"{utc[:10]} {utc[11:19]} UTC"


def _plain(value: object) -> object:
    """Return a text without control characters and of bounded length."""
    if type(value) is not str:
        return value
    text = printable(value)
    return text if len(text) <= _LETTERS else f"{text[:_LETTERS]}…"
