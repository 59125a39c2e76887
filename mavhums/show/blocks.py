"""The kinds of blocks of which an answer consists: a renderer draws them, and has no words of its own."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, TypeAlias

from mavhums.core.conditions import Condition
from mavhums.show.words import condition_word

if TYPE_CHECKING:
    from mavhums.show.evidence import CaptionedCurve
    from mavhums.show.outline import DrawnSurface

NOTHING: Final = "—"
"""What a cell shows that has nothing to say."""


class Mark(NamedTuple):
    """A condition, which a renderer colours; ``word`` is what it is called where that is not its name."""

    condition: Condition
    word: str = ""

    @property
    def text(self) -> str:
        """The word; of what must be acted on in capitals."""
        return self.word or condition_word(self.condition)


class Anchor(NamedTuple):
    """A text that leads to an address, where a renderer can follow one."""

    text: str
    address: str


Part: TypeAlias = str | Mark | Anchor
Cell: TypeAlias = str | list[Part]


class Column(NamedTuple):
    """A column of a table.

    Attributes
    ----------
    kind
        A text may wrap, a word and a figure may not; figures are on the right.
    rank
        Where there is no room for all columns, those of the highest rank go first; one of rank 0 stays.
    """

    title: str
    kind: Literal["text", "word", "figure"] = "text"
    rank: int = 0


class Headline(NamedTuple):
    """The answer in a line: what was found, the gravest condition, what to do, and about which log."""

    text: str
    condition: Condition | None = None
    todo: str = ""
    about: str = ""
    word: str = ""

    @property
    def mark(self) -> Mark | None:
        """The condition, or what is so beside every condition, as a crash."""
        return Mark(self.condition, self.word) if self.condition else None


class Note(NamedTuple):
    """Sentences; quiet ones are of less weight."""

    lines: Sequence[str]
    quiet: bool = False


class TableBlock(NamedTuple):
    """A table; without rows its title says it all."""

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]


class Finding(NamedTuple):
    """What was found about a subject: why, what to do, and facts; ``table`` has the estimates."""

    title: str
    condition: Condition
    why: Sequence[str]
    todo: str = ""
    facts: Sequence[str] = ()
    table: TableBlock | None = None


class Listing(NamedTuple):
    """Sentences under a title."""

    title: str
    lines: Sequence[str]


class Curves(NamedTuple):
    """Curves over the flight, and how they are read."""

    title: str
    note: str
    curves: Sequence[CaptionedCurve]
    duration_s: float


class Craft(NamedTuple):
    """The outline of a vehicle with the condition of each part."""

    title: str
    parts: Sequence[DrawnSurface]
    body: Sequence[str]

    @property
    def note(self) -> str:
        """What the drawing does not know; empty where each part has its place."""
        sides = any(len(part.points) > 1 for part in self.parts)
        return "An output that is drawn on both sides moves both, or the log does not name its side." * sides


Block: TypeAlias = Headline | Note | TableBlock | Finding | Listing | Curves | Craft


def table(title: str, columns: Sequence[Column], rows: Iterable[Sequence[Cell]]) -> TableBlock:
    """Return a table without the columns in which no row says anything, but for those that always stay.

    Examples
    --------
    >>> table("", [Column("of"), Column("since", rank=1)], [["roll", "—"], ["yaw", "—"]]).columns
    [Column(title='of', kind='text', rank=0)]
    """
    kept = [*rows]
    shown = [
        k for k, column in enumerate(columns) if not column.rank or any(row[k] != NOTHING for row in kept)
    ]
    return TableBlock(title, [columns[k] for k in shown], [[row[k] for k in shown] for row in kept])
