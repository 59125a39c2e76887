"""What a process of the page does: it judges one log after the other, with limited memory."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, MutableSequence
from pathlib import Path
from typing import Any, Final

from mavhums.app.analysis import Failed, judge
from mavhums.app.settings import Options, Settings
from mavhums.app.sinks import Recording, Report, Sink
from mavhums.core.packed import ArchiveError
from mavhums.serve.uploads import take_logs
from mavhums.show.headline import headline

_FILES: Final = 256

Job = dict[str, Any]


def limit(memory_bytes: int) -> None:
    """Limit memory and files of this process, and let others go first, where the system can."""
    if sys.platform == "win32":
        return
    import resource

    os.dup2(2, 1)  # what a library prints is none of the server's output
    os.nice(5)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_NOFILE, (_FILES, _FILES))
    if sys.platform == "linux":
        resource.setrlimit(resource.RLIMIT_DATA, (memory_bytes, memory_bytes))


def answer(read: MutableSequence[int], placed: tuple[int, Job]) -> Job:
    """Return the answer to a job, whatever happens; ``read`` has at its place how many bytes were read."""
    place, job = placed

    def progress(count: int) -> None:
        read[place] = count

    return _answer(job, progress)


def _answer(job: Job, progress: Callable[[int], None]) -> Job:
    if job["do"] == "start":
        return {}
    log = Path(job["log"])
    try:
        if job["do"] == "unpack":
            return _unpack(job)
        settings = _settings(job)
    except Exception as error:
        return _refusal(Failed.of(log, error), job)
    judged = judge(log, settings, _sinks(job), progress)
    if isinstance(judged, Failed):
        return _refusal(judged, job)
    if job["do"] == "record":
        return {"recorded": True}
    assessment = judged.assessment
    if "assessment" in job:
        log_file = assessment.log.model_copy(update={"path": log.name})  # its folder is of no use to anybody
        text = assessment.model_copy(update={"log": log_file}).to_json()
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


def _unpack(job: Job) -> Job:
    taken = take_logs(Path(job["log"]), Path(job["into"]), job["most_bytes"], job["most_logs"])
    return {"logs": None} if taken is None else {"logs": list(map(str, taken.logs)), "others": taken.others}


def _settings(job: Job) -> Settings:
    settings = Settings.read(Options(**job["options"]))
    # the page's store begins with the first log that somebody keeps
    return settings if settings.store is None or settings.store.exists else settings.alone()
