"""Text from outside, made harmless for a terminal, a viewer or a spreadsheet."""

from __future__ import annotations

__all__ = ["no_formula", "printable"]

_FORMULA = ("=", "+", "-", "@", "\t", "\r", "＝", "＋", "－", "＠")


def printable(text: str) -> str:
    r"""Return a text from outside without what a terminal or a viewer would obey.

    Examples
    --------
    >>> printable("S1\x1b[31m")
    'S1�[31m'
    """
    return "".join(letter if letter.isprintable() else "�" for letter in text)


def no_formula(text: str) -> str:
    """Return a text that a spreadsheet shows and does not compute: an apostrophe goes before a formula.

    Examples
    --------
    >>> no_formula("=HYPERLINK(1)"), no_formula("elevator")
    ("'=HYPERLINK(1)", 'elevator')
    """
    return f"'{text}" if text.startswith(_FORMULA) else text
