"""Keeps the recording of a live session among the earlier flights of its aircraft."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mavhums.cli.keeping import divided, judged_in_store
from mavhums.cli.output import complain, say
from mavhums.core.errors import ExitCode, MavhumsError

if TYPE_CHECKING:
    from mavhums.app.options import Options
    from mavhums.report.assessment import Assessment

_JUDGED_BY = ("airframe", "model", "decide", "dialect", "false_alarms", "key")

__all__ = ["Keeper"]


class Keeper:
    """Puts the recording of a session among the earlier flights.

    Parameters
    ----------
    judging
        Options by which the recording is judged.
    history
        Folder of an aircraft's flights, or store of a fleet.
    """

    def __init__(self, judging: Options, history: Path | str) -> None:
        self._judging = judging
        self._folder, self._store = divided(history)

    @classmethod
    def of(cls, options: dict[str, Any]) -> Keeper | None:
        """Take the options of keeping, and replace a store by the flights of the aircraft in it.

        Raises
        ------
        UsageError
            If another option is missing.
        """
        from mavhums.app.options import Options

        wanted, aircraft, history = options.pop("keep"), options.pop("aircraft"), options["history"]
        store = divided(history)[1]
        if wanted and (history is None or options["record"] is None):
            raise click.UsageError("--keep needs --history DIR and --record FILE")
        if (store is None) != (aircraft is None):
            told = "--aircraft NAME: a store holds several" if store else "--history STORE for --aircraft"
            raise click.UsageError(f"name {told}")
        judging = Options(
            **{
                name: options[name]
                for name in ("airframe", "model", "decide", "dialect", "false_alarms", "key")
            },
            aircraft=f"={aircraft}" if aircraft else None,
            aircraft_table=options["aircraft_table"],
        )
        if store is not None:
            from mavhums.fleet import past
            from mavhums.flights.aircraft import latest

            now = datetime.now(UTC)
            flown = past(store, aircraft, now)
            dates = latest(flown.since, judging.whose().table.since(aircraft, now))
            options |= {"history": flown.history, "dates": tuple(dates.items())}
        elif history is not None:
            judging = replace(judging, since=dict(options["dates"]))
            if wanted and not Path(history).exists():
                options["history"] = None
        return cls(judging, history) if wanted else None

    def __call__(self, assessment: Assessment) -> ExitCode:
        """Keep the recording of a session; return the exit code of the command."""
        from mavhums.app.many import Batch, analyse_many

        log, code = Path(assessment.log.path or ""), assessment.exit_code
        try:
            if not log.is_file() or not log.stat().st_size:
                remedy = "check the link: the report above says what came over it"
                raise MavhumsError(f"{log}: nothing was recorded, so nothing is kept", remedy)
            if self._store is not None:
                judged = judged_in_store([log], self._store, self._judging, Batch(jobs=1), keep=True)
            else:
                folder = self._folder if self._folder and self._folder.exists() else None
                batch = Batch(jobs=1, keep=self._folder)
                judged = analyse_many([log], replace(self._judging, history=folder), batch)
            for outcome in judged:
                if outcome.error is not None:
                    raise outcome.error
        except MavhumsError as error:
            complain(error)
            return code if code in (ExitCode.EMERGENCY, ExitCode.DEGRADED) else ExitCode.ERROR
        say(f"mavhums: {log} is kept in {self._store or self._folder}", err=True)
        return code
