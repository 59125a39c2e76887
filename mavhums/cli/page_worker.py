"""The processes of the page of a store: one judges logs by their aircraft's flights in it, one keeps logs."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mavhums.core.errors import MavhumsError
from mavhums.core.output import written_whole
from mavhums.flights.aircraft import UnnamedAircraftError
from mavhums.flights.history import is_store

if TYPE_CHECKING:
    from collections.abc import Callable

    from mavhums.app.many import Outcome
    from mavhums.app.settings import Settings

__all__ = ["against_store", "answer_to"]

_FOLDER: Final = "kept"
_PATIENCE_S: Final = (
    3600.0  # a scan of a large folder takes as long; the log stays with its session meanwhile
)
_EVERY_S: Final = 1.0


def against_store(store: Path, log: str, settings: Settings) -> Settings:
    """Return the settings for a log among the flights in a store; a new folder has none."""
    if not is_store(store):
        return settings
    from mavhums.fleet import against

    return against(log, store, settings)


def answer_to(job: dict[str, Any]) -> dict[str, Any]:
    """Return what was done as ``told``, or ``problem``, ``remedy`` and the aircraft that are ``proposed``."""
    from mavhums.app.analysis import Failed

    try:
        return {"told": _kept(Path(job["log"]), Path(job["store"]), job["options"])}
    except UnnamedAircraftError as error:
        return {"problem": error.problem, "remedy": error.remedy, "proposed": list(error.proposed)}
    except Exception as error:  # whatever it is, the page shows it and goes on
        failed = Failed.of(Path(Path(job["log"]).name), error)
        return {"problem": failed.problem, "remedy": failed.remedy}


def _kept(log: Path, store: Path, options: dict[str, Any]) -> str:
    """Copy a log beside the store's tables and judge it there; a copy that is not kept is removed."""
    from mavhums.app.settings import Options
    from mavhums.fleet import keep

    with log.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    copy = store.absolute() / _FOLDER / digest[:16] / log.name
    try:
        copy.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(copy) as temporary:
            shutil.copyfile(log, temporary)
    except OSError as error:
        raise MavhumsError(f"cannot be stored: {error.strerror}", "make room in the store") from error
    try:
        outcome = _patiently(lambda: next(keep([copy], store, Options(**options))))
        if outcome.error is not None:
            raise outcome.error
        if _lies_there(store, copy):
            return f"kept in the store as {copy.name}; see the fleet"
    except BaseException as error:
        _remove(copy)
        if isinstance(error, MavhumsError):
            error.problem = error.problem.replace(str(copy), log.name)
        raise
    _remove(copy)
    return "the store has this log already; see the fleet"


def _patiently(work: Callable[[], Outcome]) -> Outcome:
    """Return what work gives, as soon as no other scan writes into the store."""
    import filelock

    end_s = time.monotonic() + _PATIENCE_S
    while True:
        try:
            return work()
        except MavhumsError as error:
            if not isinstance(error.__cause__, filelock.Timeout) or time.monotonic() > end_s:
                raise
        time.sleep(_EVERY_S)


def _lies_there(store: Path, copy: Path) -> bool:
    from mavhums.flights.store import Store

    return bool(Store(store).query("SELECT 1 FROM logs WHERE path = ? LIMIT 1", str(copy)).fetchone())


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
    if sys.argv[1] == "keep":
        _keep_one()
    else:
        from mavhums.serve.worker import main

        main(int(sys.argv[1]), lambda log, settings: against_store(Path(sys.argv[2]), log, settings))
