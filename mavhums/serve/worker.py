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
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from mavhums.app.analysis import Failed, judge
from mavhums.app.settings import Options, Settings
from mavhums.app.sinks import Recording, Report, Sink
from mavhums.core.packed import ArchiveError
from mavhums.serve.uploads import take_logs
from mavhums.show.headline import headline

_TOLD_S: Final = 0.1
_FILES: Final = 256

Job = dict[str, Any]
Tell = Callable[[Job], None]


def main(memory_bytes: int) -> None:
    """Judge until the standard input ends, with at most so much memory."""
    output = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a library prints must not be taken for an answer
    jobs: queue.SimpleQueue[Job] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(jobs,), daemon=True).start()
    _limit(memory_bytes)

    def tell(content: Job) -> None:
        output.write(json.dumps(content) + "\n")
        output.flush()

    import_module("mavhums.engine.engine")  # so that the first log need not wait for it
    tell({"ready": True})
    while True:
        tell(_done(jobs.get(), tell))


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


def _done(job: Job, tell: Tell) -> Job:
    """Return the answer to a job, whatever happens."""
    log = Path(job["log"])
    try:
        if job["do"] == "unpack":
            return _unpack(job)
        settings = _settings(job)
    except Exception as error:
        return _refusal(Failed.of(log, error), job)
    judged = judge(log, settings, _sinks(job), _reporting(tell))
    if isinstance(judged, Failed):
        return _refusal(judged, job)
    if job["do"] == "record":
        return {"recorded": True}
    assessment = judged.assessment
    if "assessment" in job:
        told = assessment.log.model_copy(update={"path": log.name})  # its folder is of no use to anybody
        text = assessment.model_copy(update={"log": told}).to_json()
        Path(job["assessment"]).write_text(text, encoding="utf-8", errors="replace")
    return {"brief": headline(assessment)._asdict()}


def _sinks(job: Job) -> list[Sink]:
    sinks: list[Sink] = [Report(job["report"], job.get("shown"))] if "report" in job else []
    return [*sinks, *([Recording(job["recording"])] if "recording" in job else [])]


def _refusal(failed: Failed, job: Job) -> Job:
    """Return problem and remedy without the temporary folder of the log."""
    unpacked = "unpack it, and drop the logs in it"
    remedy = unpacked if isinstance(failed.cause, ArchiveError) else failed.remedy
    folder = f"{Path(job['log']).parent}{os.sep}"
    return {"problem": failed.problem.replace(folder, ""), "remedy": remedy.replace(folder, "")}


def _reporting(tell: Tell) -> Callable[[int], None]:
    """Return a function that reports how much was read, some times a second."""
    told_s = 0.0

    def progress(read: int) -> None:
        nonlocal told_s
        if time.monotonic() - told_s > _TOLD_S:
            told_s = time.monotonic()
            tell({"read": read})

    return progress


def _unpack(job: Job) -> Job:
    taken = take_logs(Path(job["log"]), Path(job["into"]), job["most_bytes"], job["most_logs"])
    return {"logs": None} if taken is None else {"logs": list(map(str, taken.logs)), "others": taken.others}


def _settings(job: Job) -> Settings:
    settings = Settings.read(Options(**job["options"]))
    # the page's store begins with the first log that somebody keeps
    return settings if settings.store is None or settings.store.exists else settings.alone()


if __name__ == "__main__":
    main(int(sys.argv[1]))
