"""The recording of a flight for Rerun: its scene on a stream, the report, the properties, and the file."""

from __future__ import annotations

import os
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.core.output import WholeFile
from mavhums.engine.events import Event
from mavhums.results.assessment import Assessment

if TYPE_CHECKING:
    import rerun as rr

    from mavhums.show._scene import Scene

_FOOTER, _FOOTER_SIZE = b"RRF2FOOT", 12
_WRITTEN_S = 60.0


class Recorder:
    """Writes the engine's events as an ``.rrd``, in bounded memory.

    Until :meth:`close` the recording is a hidden temporary file beside ``path``; leaving the
    ``with`` block without closing removes it, so ``path`` never holds an incomplete flight.

    Parameters
    ----------
    path
        The recording to write, an older one is replaced; None for the standard output, where a viewer reads.
    recording_id
        Id of this flight among others; the same flight keeps the same.
    position
        Whether the recording may contain the aircraft's position.

    Raises
    ------
    MissingExtraError
        If rerun is not installed.

    Examples
    --------
    >>> with Recorder("flight.rrd", recording_id="6f1c") as recorder:  # doctest: +SKIP
    ...     recorder.consume(engine.feed(block))
    ...     recorder.close(engine.assessment())
    """

    def __init__(
        self, path: str | os.PathLike[str] | None, *, recording_id: str, position: bool = True
    ) -> None:
        self._path = Path("flight" if path is None else path)
        self._pipes = path is None
        self._file: WholeFile | None = None
        self._stream, self._scene = draw(recording_id, position=position)

    def __enter__(self) -> Self:
        if self._pipes:
            self._stream.stdout()
            return self
        try:
            self._file = WholeFile(self._path)
            self._stream.save(self._file.temporary)
        except Exception as error:
            self.__exit__(None, None, None)
            problem = f"cannot write {self._path}: {self._why(error)}"
            raise MavhumsError(problem, "choose another place") from error
        return self

    def _why(self, error: Exception) -> str:
        """Return what is wrong with the place, without the name of the temporary file in it."""
        if not self._path.parent.is_dir():
            return f"there is no folder {self._path.parent}"
        if isinstance(error, OSError) and error.strerror:
            return error.strerror
        return str(error).replace(str(self._file.temporary), str(self._path)) if self._file else str(error)

    def __exit__(self, *_: object) -> None:
        self._stream.disconnect()
        if self._file:
            self._file.discard()

    def consume(self, events: Iterable[Event]) -> None:
        """Take what the engine reports, in its order."""
        self._scene.consume(events)

    def close(self, assessment: Assessment) -> None:
        """Write the report, the properties and the layout, and put the recording in its place."""
        end(self._stream, self._scene, assessment, self._path.stem)
        if self._file:
            self._publish(self._file)
        else:
            self._stream.flush()

    def _publish(self, file: WholeFile) -> None:
        """Finish the temporary file, check it (rerun only logs write errors), and rename it."""
        try:
            # Without a limit Rerun may wait for ever for its writer, which ends when the disk is full.
            self._stream.flush(timeout_sec=_WRITTEN_S)
            self._stream.disconnect()
            with file.temporary.open("rb") as written:
                written.seek(-_FOOTER_SIZE, os.SEEK_END)
                if not written.read().startswith(_FOOTER):
                    raise OSError("its end is missing")
            file.publish()
        except (OSError, RuntimeError) as error:
            raise MavhumsError(f"cannot write {self._path}: {error}", "is the disk full?") from error


def check_viewer() -> None:
    """Raise before any long work where a recording cannot be written.

    Raises
    ------
    MissingExtraError
        If rerun is not installed.
    """
    try:
        import rerun  # noqa: F401  (only whether it can be imported)
    except ImportError as error:
        raise MissingExtraError("a recording or a live view", "viewer") from error


def draw(recording_id: str, *, live: bool = False, position: bool = True) -> tuple[rr.RecordingStream, Scene]:
    """Return a stream without a destination, and the scene that draws on it.

    Raises
    ------
    MissingExtraError
        If rerun is not installed.
    """
    check_viewer()
    from mavhums.show._scene import Scene
    from mavhums.show._signals import open_stream

    stream = open_stream(recording_id)
    return stream, Scene(stream, live=live, position=position)


def end(stream: rr.RecordingStream, scene: Scene, assessment: Assessment, name: str) -> None:
    """Draw the end of a flight, its report, its properties and the final layout."""
    blueprint = scene.finish(assessment)
    path = assessment.log.path
    _describe(stream, assessment, Path(path).name if path else name)
    stream.send_blueprint(blueprint, make_active=True, make_default=True)


def _describe(stream: rr.RecordingStream, assessment: Assessment, name: str) -> None:
    """Write the properties that identify a recording in a catalogue: vehicle, worst actuator, condition."""
    import rerun as rr

    log = assessment.log
    stream.send_recording_name(name)
    if log.start_utc:
        start = datetime.fromisoformat(log.start_utc)
        start = start if start.tzinfo else start.replace(tzinfo=UTC)
        stream.send_recording_start_time_nanos(round(start.timestamp() * 1e6) * 1000)
    properties: dict[str, Any] = {"notice": assessment.notice, "duration_s": log.duration_s}
    if assessment.airframe:
        properties["airframe"] = assessment.airframe
    if assessment.verdicts:
        worst = assessment.ranked()[0]
        properties |= {"worst_actuator": worst.actuator, "condition": worst.gravest}
        if worst.vehicle is not None:
            properties["vehicle"] = worst.vehicle
    stream.send_property("mavhums", rr.AnyValues(**properties))
