"""Keeps a log that was dropped in the store: a copy of it beside it, judged in a process of its own."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

from mavhums.app.settings import Options
from mavhums.core.errors import MavhumsError
from mavhums.core.output import written_whole
from mavhums.flights.aircraft import UnnamedAircraftError

_LOGS: Final = ".logs"
"""Ends the name of the folder beside a store with the logs that were kept in it."""


def keep(options: Options, log: Path, aircraft: str | None = None) -> str:
    """Keep a log in the options' store, in a process of its own; return what was done in one line.

    Raises
    ------
    UnnamedAircraftError
        If the store cannot identify its aircraft, and none is given.
    MavhumsError
        If it cannot be kept.
    """
    given = options.as_texts() | ({"aircraft": f"={aircraft}"} if aircraft else {})
    job = json.dumps({"log": str(log), "options": given})
    command = [sys.executable, "-m", "mavhums.serve.keep"]
    done = subprocess.run(command, input=job, capture_output=True, text=True, check=False)
    try:
        answer = json.loads(done.stdout)
    except ValueError as error:
        problem = f"the process that keeps it ended with code {done.returncode}"
        raise MavhumsError(problem, "keep it with `mavhums analyse --keep`") from error
    if "done" in answer:
        return str(answer["done"])
    folder = f"{Path(str(options.store)).absolute().parent}{os.sep}"
    problem, remedy = (answer[key].replace(folder, "") for key in ("problem", "remedy"))
    if "proposed" in answer:
        raise UnnamedAircraftError(problem, remedy, tuple(answer["proposed"]))
    raise MavhumsError(problem, remedy)


def answer_to(job: dict[str, Any]) -> dict[str, Any]:
    """Return what was done as ``done``, or ``problem``, ``remedy`` and the aircraft that are ``proposed``."""
    from mavhums.app.analysis import Failed

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
