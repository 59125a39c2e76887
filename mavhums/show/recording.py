"""A flight as a Rerun recording, written while the engine reads."""

from __future__ import annotations

import os
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from secrets import token_hex
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from mavhums.actuator.profile import Limits
from mavhums.assessment import Assessment, Condition
from mavhums.errors import MavhumsError, MissingExtraError
from mavhums.events import AirframeNamed, ConditionChanged, Event, Notice, Samples, Window
from mavhums.show._words import clock
from mavhums.show.report import markdown

if TYPE_CHECKING:
    import rerun as rr

    from mavhums.show._tracks import Texts, Track

__all__ = ["Recorder"]

_FOOTER, _FOOTER_SIZE = b"RRF2FOOT", 12
_LEVELS: dict[Condition, str] = {
    "normal": "INFO",
    "degraded": "WARN",
    "emergency": "ERROR",
    "undecided": "INFO",
}


class Recorder:
    """Writes the engine's events as an ``.rrd``, in memory that does not grow with the flight.

    Until :meth:`close` the recording is a hidden temporary file beside ``path``; leaving the
    ``with`` block without having closed removes it, so ``path`` never holds half a flight.

    Parameters
    ----------
    path
        The recording to write; an older one is replaced.
    recording_id
        What tells this flight from others; the same flight keeps the same.

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

    def __init__(self, path: str | os.PathLike[str], *, recording_id: str) -> None:
        try:
            import rerun as rr

            from mavhums.show import _tracks
        except ImportError as error:
            raise MissingExtraError("writing a recording", "viewer") from error
        self._path = Path(path)
        self._temporary = self._path.with_name(f".{self._path.name}.{token_hex(4)}.part")
        self._limits: dict[tuple[int | None, str], tuple[Limits, float]] = {}
        self._stream: rr.RecordingStream = rr.RecordingStream(
            "mavhums", recording_id=recording_id, send_properties=False
        )
        self._stream.set_log_tick_enabled(False)
        self._stream.set_log_time_enabled(False)
        self._make_track = _tracks.Track
        self._texts: Texts = _tracks.Texts(self._stream)
        self._tracks: dict[tuple[int | None, str], Track] = {}

    def __enter__(self) -> Self:
        try:
            self._stream.save(self._temporary)
        except Exception as error:
            raise MavhumsError(f"cannot write {self._path}: {error}", "choose another place") from error
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stream.disconnect()
        self._temporary.unlink(missing_ok=True)

    def consume(self, events: Iterable[Event]) -> None:
        """Take what the engine reports, in its order."""
        for event in events:
            match event:
                case Samples():
                    self._track(event.vehicle, event.actuator).samples(event)
                case Window():
                    self._track(event.vehicle, event.actuator).window(event)
                case ConditionChanged():
                    self._track(event.vehicle, event.actuator).changed(event)
                    self._texts.add(event.time_s, _LEVELS[event.after], _change(event))
                case AirframeNamed():
                    self._name_airframe(event)
                case Notice():
                    sender = "log" if event.vehicle is None else f"vehicle {event.vehicle}"
                    self._texts.add(event.time_s, "INFO", f"{sender}: {event.text}")

    def close(self, assessment: Assessment) -> None:
        """Write the report, the properties and the layout, and put the recording in its place."""
        import rerun as rr

        from mavhums.show.blueprint import layout

        for verdict in assessment.verdicts:
            self._track(verdict.vehicle, verdict.actuator)
        for (vehicle, actuator), track in self._tracks.items():
            track.finish()
            known = self._limits.get((vehicle, actuator)) or self._limits.get((None, actuator))
            if known:
                track.limits(*known)
        self._texts.flush()
        report = rr.TextDocument(markdown(assessment), media_type=rr.MediaType.MARKDOWN)
        self._stream.log("/report", report, static=True)
        self._describe(assessment)
        present = {track.root: frozenset(track.present) for track in self._tracks.values()}
        self._stream.send_blueprint(layout(assessment, present), make_active=True, make_default=True)
        self._publish()

    def _publish(self) -> None:
        """Finish the temporary file and rename it; rerun only logs what fails at a file's end, so look."""
        try:
            self._stream.flush()
            self._stream.disconnect()
            with self._temporary.open("rb") as file:
                file.seek(-_FOOTER_SIZE, os.SEEK_END)
                if not file.read().startswith(_FOOTER):
                    raise OSError("its end is missing")
            self._temporary.replace(self._path)
        except (OSError, RuntimeError) as error:
            raise MavhumsError(f"cannot write {self._path}: {error}", "is the disk full?") from error

    def _describe(self, assessment: Assessment) -> None:
        import rerun as rr

        log = assessment.log
        self._stream.send_recording_name(Path(log.path).name if log.path else self._path.stem)
        if log.start_utc:
            start = datetime.fromisoformat(log.start_utc)
            start = start if start.tzinfo else start.replace(tzinfo=UTC)
            self._stream.send_recording_start_time_nanos(round(start.timestamp() * 1e6) * 1000)
        properties: dict[str, Any] = {"notice": assessment.notice, "duration_s": log.duration_s}
        if assessment.airframe:
            properties["airframe"] = assessment.airframe
        if assessment.verdicts:
            worst = assessment.ranked()[0]
            properties |= {"worst_actuator": worst.actuator, "condition": worst.gravest}
            if worst.vehicle is not None:
                properties["vehicle"] = worst.vehicle
        self._stream.send_property("mavhums", rr.AnyValues(**properties))

    def _name_airframe(self, event: AirframeNamed) -> None:
        self._texts.add(event.time_s, "INFO", f"judged by the airframe profile {event.airframe.name}")
        for part in event.airframe.actuators:
            if part.limits is not None:
                self._limits[event.vehicle, part.name] = part.limits, event.time_s

    def _track(self, vehicle: int | None, actuator: str) -> Track:
        key = (vehicle, actuator)
        if key not in self._tracks:
            self._tracks[key] = self._make_track(self._stream, vehicle, actuator)
        return self._tracks[key]


def _change(event: ConditionChanged) -> str:
    who = f"{event.actuator} (vehicle {event.vehicle})"
    return f"{who}: {event.before} → {event.after} since {clock(event.since_s)}: {event.rule}"
