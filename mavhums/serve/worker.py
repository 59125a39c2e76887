"""The process that judges logs for the page: jobs come in as JSON lines, answers go out as JSON lines.

It limits its own memory, and ends when the page's process ends. Nothing is pickled.
"""

from __future__ import annotations

import json
import os
import queue
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mavhums.core.errors import MavhumsError
from mavhums.core.packed import ArchiveError

if TYPE_CHECKING:
    from mavhums.app.options import Options

__all__ = ["main"]

_TOLD_S: Final = 0.1
_FILES: Final = 256

Job = dict[str, Any]
Tell = Callable[[Job], None]
Among = Callable[[str, "Options"], "Options"]


def main(memory_bytes: int, among: Among | None = None) -> None:
    """Judge until the standard input ends.

    Parameters
    ----------
    memory_bytes
        Most memory that this process may use.
    among
        Returns the options for a log among earlier flights that only the caller knows; None for no others.
    """
    output = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a library prints must not be taken for an answer
    jobs: queue.SimpleQueue[Job] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(jobs,), daemon=True).start()
    _limit(memory_bytes)

    def tell(content: Job) -> None:
        output.write(json.dumps(content) + "\n")
        output.flush()

    _prepare()
    tell({"ready": True})
    while True:
        tell(_done(jobs.get(), tell, among or (lambda _, options: options)))


def _listen(jobs: queue.SimpleQueue[Job]) -> None:
    for line in sys.stdin:
        jobs.put(json.loads(line))
    os._exit(0)


def _limit(memory_bytes: int) -> None:
    """Limit memory and files of this process, and let others go first, where the system can."""
    if sys.platform == "win32":
        return
    import resource

    os.nice(5)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_NOFILE, (_FILES, _FILES))
    if sys.platform == "linux":
        resource.setrlimit(resource.RLIMIT_DATA, (memory_bytes, memory_bytes))


def _prepare() -> None:
    """Load and compile what the first log needs."""
    from mavhums.app.warm_up import warm_up

    warm_up()


def _done(job: Job, tell: Tell, among: Among) -> Job:
    """Return the answer to a job, whatever happens."""
    try:
        if job["do"] == "unpack":
            return _unpack(job)
        options = among(job["log"], _options(job))
        return _record(job, options) if job["do"] == "record" else _judge(job, options, tell)
    except ArchiveError as error:
        return {
            "problem": _without_folder(error.problem, job),
            "remedy": "unpack it, and drop the logs in it",
        }
    except MavhumsError as error:
        return {
            "problem": _without_folder(error.problem, job),
            "remedy": _without_folder(error.remedy, job),
        }
    except MemoryError:
        return {
            "problem": "needs more memory than the page allows",
            "remedy": "judge it with mavhums analyse",
        }
    except Exception as error:
        problem = f"cannot be judged: {type(error).__name__}: {str(error)[:200]}"
        return {"problem": problem, "remedy": "please report it with the log, if you may share it"}


def _without_folder(text: str, job: Job) -> str:
    """Return a problem or remedy without the temporary folder of the log."""
    return text.replace(f"{Path(job['log']).parent}{os.sep}", "")


def _judge(job: Job, options: Options, tell: Tell) -> Job:
    from mavhums.app.report import write_report
    from mavhums.show.html import in_brief

    told_s = 0.0

    def progress(read: int) -> None:
        nonlocal told_s
        if time.monotonic() - told_s > _TOLD_S:
            told_s = time.monotonic()
            tell({"read": read})

    assessment = write_report(job["log"], job["report"], options, progress=progress)
    return {"brief": in_brief(assessment)._asdict()}


def _unpack(job: Job) -> Job:
    from mavhums.serve.archives import take_logs

    taken = take_logs(Path(job["log"]), Path(job["into"]), job["most_bytes"], job["most_logs"])
    return {"logs": None} if taken is None else {"logs": list(map(str, taken.logs)), "others": taken.others}


def _record(job: Job, options: Options) -> Job:
    from mavhums.app.analysis import analyse

    analyse(job["log"], options, recording=job["recording"])
    return {"recorded": True}


def _options(job: Job) -> Options:
    from mavhums.app.options import Options

    return Options(**job["options"])


if __name__ == "__main__":
    main(int(sys.argv[1]))
