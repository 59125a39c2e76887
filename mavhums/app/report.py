"""Judges a log and writes the result as one HTML file."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from mavhums.app.analysis import analyse
from mavhums.app.options import Options
from mavhums.core.errors import MavhumsError
from mavhums.core.files import written_whole
from mavhums.report.assessment import Assessment
from mavhums.show.html import page
from mavhums.show.html_curves import Gathered

__all__ = ["write_report"]


def write_report(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    options: Options | None = None,
    *,
    progress: Callable[[int], None] | None = None,
) -> Assessment:
    """Judge a log and write the result as one self-contained HTML file, in bounded memory.

    Parameters
    ----------
    path
        The log; ``-`` for the standard input.
    output
        The page; it is written whole or not at all, and replaces an older one.
    options
        Profile, model, history and the like; the defaults if None.
    progress
        Called with the number of bytes read after each block.

    Raises
    ------
    UnreadableLogError
        If the log is missing or its format is unknown.
    ProfileError, ModelError, DialectError, KeyFileError
        If the profile, the model, the XML or the key cannot be used.
    MavhumsError
        If the page cannot be written, or would replace the log.

    Examples
    --------
    >>> write_report("flight.tlog", "report.html").exit_code.name
    'EMERGENCY'
    """
    log, target = Path(path), Path(output)
    if log.exists() and target.exists() and log.samefile(target):
        raise MavhumsError(f"{target}: is the log itself", "name another file with -o")
    gathered = Gathered()
    with written_whole(target) as temporary:
        shown = replace(options or Options(), vehicle_states=True)  # demanded and flown angles among them
        assessment = analyse(path, shown, consume=gathered.consume, progress=progress)
        temporary.write_text(page(assessment, gathered), encoding="utf-8", errors="replace")
    return assessment
