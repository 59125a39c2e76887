"""Files of a report, each written atomically."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from mavhums.core.errors import MavhumsError
from mavhums.core.files import written_whole

__all__ = ["Folder", "markdown_table"]


class Folder:
    """The folder of a report, and the list of files written into it.

    Parameters
    ----------
    path
        Created if it does not exist.

    Attributes
    ----------
    written
        Files in the order of their writing.

    Raises
    ------
    MavhumsError
        If the folder cannot be created.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.written: list[Path] = []
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise MavhumsError(f"{path}: {error.strerror}", "name a folder that you may write to") from error

    def write(self, name: str, save: Callable[[Path], object]) -> Path:
        """Let ``save`` write a file beside its place, and move it there.

        Raises
        ------
        MavhumsError
            If the file cannot be written.
        """
        path = self.path / name
        with written_whole(path, remedy="name a folder that you may write to") as temporary:
            save(temporary)
        self.written.append(path)
        return path

    def text(self, name: str, text: str) -> Path:
        """Write text as UTF-8."""
        return self.write(name, lambda path: path.write_text(text, encoding="utf-8"))

    def table(self, name: str, table: pd.DataFrame) -> Path:
        """Write a table as CSV."""
        return self.write(name, lambda path: table.to_csv(path, index=False, float_format="%.6g"))

    def figure(self, name: str, figure: Figure) -> Path:
        """Write a figure as PNG."""
        return self.write(name, lambda path: figure.savefig(path, dpi=110, format="png"))


def markdown_table(table: pd.DataFrame, digits: int = 2) -> str:
    """Return a table in Markdown, numbers rounded.

    Examples
    --------
    >>> print(markdown_table(pd.DataFrame({"input": ["V2"], "test, %": [98.012]})))
    | input | test, % |
    |---|---|
    | V2 | 98.01 |
    """
    lines = [_row(table.columns), "|" + "---|" * len(table.columns)]
    lines += [
        _row(f"{cell:.{digits}f}" if isinstance(cell, float) else cell for cell in row)
        for row in table.itertuples(index=False)
    ]
    return "\n".join(lines)


def _row(cells: Iterable[object]) -> str:
    return f"| {' | '.join(str(cell) for cell in cells)} |"
