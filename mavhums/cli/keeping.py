"""Finds out whether a history is a fleet's store, and judges logs against one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mavhums.cli.progress import steps
from mavhums.core.errors import MavhumsError
from mavhums.flights.store import is_store

if TYPE_CHECKING:
    from mavhums.app.many import Batch, Outcome
    from mavhums.app.options import Options

__all__ = ["divided", "hold_dates", "judged_in_store"]


def divided(history: Path | str | None) -> tuple[Path | None, Path | str | None]:
    """Return the folder of flights or the store of a fleet that a history is; one of the two is None."""
    if history is None or not is_store(history):
        return None if history is None else Path(history), None
    return None, history


def hold_dates(dates: Sequence[Any], history: Path | str | None) -> None:
    """Refuse dates of repairs without a history, and with a store, which keeps them itself.

    Raises
    ------
    UsageError
        If dates are given nevertheless.
    """
    if dates and history is None:
        raise click.UsageError("--baseline-from needs --history DIR")
    if dates and divided(history)[1] is not None:
        name, date = dates[0]
        entry = f"AIRCRAFT/{name or ''}={date:%Y-%m-%d}" if isinstance(date, datetime) else "DATE"
        raise click.UsageError(
            f"{history} keeps the dates of repairs: mavhums fleet repairs {history} --add {entry}"
        )


def judged_in_store(
    logs: Sequence[Path], store: Path | str, options: Options, batch: Batch, *, keep: bool
) -> Iterator[Outcome]:
    """Judge logs against the flights of their aircraft in a store, and yield each outcome.

    With ``keep``, the logs are put into the store first, as ``fleet scan`` does.
    """
    from mavhums.fleet import landing

    if keep:
        workers = batch.jobs if batch.jobs and batch.jobs > 1 else 0
        with steps("putting the logs into the store") as progress:
            outcomes = landing.keep(logs, store, options, workers=workers, progress=progress)
    else:
        outcomes = _compared(logs, store, options)
    yield from _recorded(outcomes, store, options, batch)


def _compared(logs: Sequence[Path], store: Path | str, options: Options) -> Iterator[Outcome]:
    from mavhums.app.many import Outcome
    from mavhums.fleet import landing

    for log in logs:
        try:
            yield Outcome(log, landing.analyse(log, store, options), None)
        except MavhumsError as error:
            yield Outcome(log, None, error)


def _recorded(
    outcomes: Iterator[Outcome], store: Path | str, options: Options, batch: Batch
) -> Iterator[Outcome]:
    """Write the recordings of judged logs."""
    from mavhums.fleet import landing

    for outcome in outcomes:
        output = batch.recordings.get(outcome.log)
        if output is None or outcome.assessment is None:
            yield outcome
            continue
        try:
            landing.record(outcome.log, store, options, output, position=batch.position)
            yield outcome
        except MavhumsError as error:
            yield outcome._replace(error=error)
