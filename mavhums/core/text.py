"""Sanitising of external text for a terminal, a viewer or a spreadsheet."""

from __future__ import annotations

__all__ = ["no_formula", "printable"]

_FORMULA = ("=", "+", "-", "@", "\t", "\r", "＝", "＋", "－", "＠")


def printable(text: str) -> str:
    r"""Return an external text without control sequences for a terminal or a viewer.

    Examples
    --------
    >>> printable("S1\x1b[31m")
    'S1�[31m'
    """
    return "".join(letter if letter.isprintable() else "�" for letter in text)


def no_formula(text: str) -> str:
    """Return a text that a spreadsheet displays and does not evaluate: a formula gets an apostrophe.

    Examples
    --------
    >>> no_formula("=HYPERLINK(1)"), no_formula("elevator")
    ("'=HYPERLINK(1)", 'elevator')
    """
    return f"'{text}" if text.startswith(_FORMULA) else text
