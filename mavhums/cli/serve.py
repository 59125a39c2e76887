"""The command ``serve``: the page in the browser; the processes that judge and keep logs for its store."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from mavhums.cli.options import PATH, STORE, judging
from mavhums.cli.output import say
from mavhums.core.about import EPILOG
from mavhums.core.errors import MavhumsError
from mavhums.core.output import written_whole

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mavhums.app.settings import Options
    from mavhums.flights.queries import WorstActuator
    from mavhums.results.assessment import Assessment
    from mavhums.results.standing import TrendReport
    from mavhums.results.store import StoreStatus

LEAST_MEMORY_MB = 512
"""Judging and recording a log of 4 MB beside a store takes 330 to 470 MB; with 256 MB nothing starts."""

_LOGS: Final = ".logs"
"""Ends the name of the folder beside a store with the logs that were kept in it."""


@click.command(short_help="Open a page in the browser: drop logs, see verdicts.", epilog=EPILOG)
@click.option("--port", type=click.IntRange(0, 65535), default=8080, help="0 takes a free port.")
@click.option(
    "--host",
    default="127.0.0.1",
    help="Address to listen at. Any but a loopback address lets other computers in, and needs a token.",
)
@click.option(
    "--public-name",
    "public",
    metavar="NAME[:PORT]",
    callback=lambda _, __, name: _public(name),
    help="Name under which a proxy with TLS serves the page, as docs/guide/page.md shows; it needs a token.",
)
@click.option(
    "--live",
    "lines",
    multiple=True,
    type=PATH,
    metavar="FILE",
    help="Show the session whose `mavhums live --json` writes to FILE. Can be repeated.",
)
@click.option("--max-mb", type=click.IntRange(1, 100_000), default=1000, help="Size of a log.")
@click.option("--max-seconds", type=click.IntRange(1, 86_400), default=300, help="Time to judge one.")
@click.option(
    "--max-memory-mb",
    type=click.IntRange(LEAST_MEMORY_MB, 1_000_000),
    default=2048,
    help="Memory to judge one (Linux only).",
)
@click.option("--workers", type=click.IntRange(1, 64), default=2, help="Processes that judge.")
@judging(without=["decide", "aircraft", "aircraft_table", "key"])
@STORE
def serve(
    options: Options,
    store: str | None,
    port: int,
    host: str,
    public: str | None,
    lines: tuple[Path, ...],
    max_mb: int,
    max_seconds: int,
    max_memory_mb: int,
    workers: int,
) -> None:
    """Serve a page in the browser: drop logs, see the verdicts; with a store, the fleet.

    The page works without a network, and logs never leave this computer. Nothing is kept: logs are removed
    when the session ends, unless you keep one in the store. A log is compared with the flights of its
    aircraft there.
    """
    from mavhums.learn import load_model
    from mavhums.serve import Quotas, ServeOptions
    from mavhums.serve import serve as serve_page

    if isinstance(options.model, str):
        load_model(options.model)  # a wrong name is refused now, not with the first log that somebody drops
    limits = Quotas(
        log_bytes=max_mb * 1_000_000,
        judge_s=float(max_seconds),
        memory_bytes=max_memory_mb << 20,
        workers=workers,
    )
    page = ServeOptions(
        host=host,
        port=port,
        public=public,
        judging=replace(options, store=store),
        limits=limits,
        fleet=None if store is None else _PageStore(store, options),
        live=lines,
    )
    serve_page(page, say)


def _public(name: str | None) -> str | None:
    """Hold a public name to be one: without scheme and path."""
    if name is not None and not re.fullmatch(
        r"[a-z0-9]([a-z0-9.-]*[a-z0-9])?(:[0-9]{1,5})?", name, re.IGNORECASE
    ):
        raise click.BadParameter(
            f"{name!r} is not the name of a host: write hums.example.org, without https://"
        )
    return name.lower() if name else None


class _PageStore:
    """A store as the page needs it."""

    def __init__(self, place: str, options: Options) -> None:
        from mavhums.flights.store import Store

        if not Store(place).exists and not Path(place).absolute().parent.is_dir():
            raise MavhumsError(f"{place}: no such folder", "make it, or name another store")
        self._store = place
        self._options = options.as_texts()

    def status(self) -> StoreStatus:
        from mavhums.fleet import status

        return status(self._store).published()

    def worst(self, most: int) -> Sequence[WorstActuator]:
        from mavhums.fleet import worst

        return worst(self._store, most=most)

    def trend(self, aircraft: str) -> TrendReport:
        from mavhums.fleet import trend

        return trend(self._store, aircraft)

    def flights(self, aircraft: str) -> Sequence[Assessment]:
        from mavhums.flights.queries import flights

        return flights(self._store, aircraft)

    def flight(self, aircraft: str, sha256: str) -> Assessment:
        from mavhums.flights.queries import flight

        return flight(self._store, aircraft, sha256)

    def keep(self, log: Path, aircraft: str | None = None) -> str:
        """Keep a log in the store, in a process of its own; its answer has problem and remedy."""
        options = self._options | ({"aircraft": f"={aircraft}"} if aircraft else {})
        job = {"log": str(log), "options": options | {"store": self._store}}
        command = [sys.executable, "-m", "mavhums.cli.serve"]
        done = subprocess.run(command, input=json.dumps(job), capture_output=True, text=True, check=False)
        try:
            answer = json.loads(done.stdout)
        except ValueError as error:
            problem = f"the process that keeps it ended with code {done.returncode}"
            raise MavhumsError(problem, "keep it with `mavhums analyse --keep`") from error
        if "done" in answer:
            return str(answer["done"])
        folder = f"{Path(self._store).absolute().parent}{os.sep}"
        problem, remedy = (answer[key].replace(folder, "") for key in ("problem", "remedy"))
        if "proposed" in answer:
            from mavhums.flights.aircraft import UnnamedAircraftError

            raise UnnamedAircraftError(problem, remedy, tuple(answer["proposed"]))
        raise MavhumsError(problem, remedy)


def answer_to(job: dict[str, Any]) -> dict[str, Any]:
    """Return what was done as ``done``, or ``problem``, ``remedy`` and the aircraft that are ``proposed``."""
    from mavhums.app.analysis import Failed
    from mavhums.flights.aircraft import UnnamedAircraftError

    try:
        return {"done": _kept(Path(job["log"]), job["options"])}
    except UnnamedAircraftError as error:
        return {"problem": error.problem, "remedy": error.remedy, "proposed": list(error.proposed)}
    except Exception as error:  # whatever it is, the page shows it and goes on
        failed = Failed.of(Path(Path(job["log"]).name), error)
        return {"problem": failed.problem, "remedy": failed.remedy}


def _kept(log: Path, options: dict[str, Any]) -> str:
    """Copy a log into a folder beside the store and judge it there; a copy that is not kept is removed."""
    from mavhums.app.analysis import analyse
    from mavhums.app.settings import Options

    if "://" in options["store"]:
        remedy = "keep it with `mavhums analyse --keep`, where it lies"
        raise MavhumsError("a store at an address has no folder for logs", remedy)
    store = Path(options["store"])
    with log.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    copy = store.absolute().with_name(f"{store.name}{_LOGS}") / digest[:16] / log.name
    try:
        copy.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(copy) as temporary:
            shutil.copyfile(log, temporary)
    except OSError as error:
        raise MavhumsError(f"cannot be stored: {error.strerror}", "make room in the store") from error
    try:
        analyse(copy, Options(**options), keep=True)
        if _lies_there(store, copy):
            return f"kept in the store as {copy.name}; see the fleet"
    except BaseException as error:
        _remove(copy)
        if isinstance(error, MavhumsError):
            error.problem = error.problem.replace(str(copy), log.name)
        raise
    _remove(copy)
    return "the store has this log already; see the fleet"


def _lies_there(store: Path, copy: Path) -> bool:
    from sqlalchemy import select

    from mavhums.flights.store import Store
    from mavhums.flights.store.tables import LOG

    with Store(store).reading() as connection:
        return connection.scalar(select(LOG.c.id).where(LOG.c.path == str(copy))) is not None


def _remove(copy: Path) -> None:
    copy.unlink(missing_ok=True)
    if not any(copy.parent.iterdir()):
        copy.parent.rmdir()


def _keep_one() -> None:
    """Take a job from the standard input, and write its answer to the standard output."""
    output = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a library prints must not be taken for the answer
    output.write(json.dumps(answer_to(json.load(sys.stdin))))
    output.close()


if __name__ == "__main__":
    _keep_one()
