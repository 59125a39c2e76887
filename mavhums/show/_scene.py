"""Everything that is drawn of a flight, onto a stream that leads to a file or to a viewer."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import rerun as rr
import rerun.blueprint as rrb

from mavhums.actuator.profile import Limits
from mavhums.assessment import Assessment, Condition
from mavhums.events import AirframeNamed, ConditionChanged, Event, Notice, Samples, Window
from mavhums.show._stream import send
from mavhums.show._tracks import Track
from mavhums.show._words import clock
from mavhums.show.blueprint import Lane, layout
from mavhums.show.report import markdown, so_far

__all__ = ["Scene"]

_LEVELS: Final[dict[str, str]] = {"degraded": "WARN", "emergency": "ERROR"}
_TEXTS_PER_CHUNK: Final = 4096


class Scene:
    """Draws the engine's events.

    Parameters
    ----------
    stream
        Where to.
    """

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._limits: dict[tuple[int | None, str], tuple[Limits, float]] = {}
        self._tracks: dict[tuple[int | None, str], Track] = {}
        self._texts: list[tuple[float, str, str]] = []
        self._report = ""

    @property
    def tracks(self) -> list[Track]:
        """One for each actuator, in the order of their appearance."""
        return list(self._tracks.values())

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
                    self._say(event.time_s, _LEVELS.get(event.after, "INFO"), _change(event))
                case AirframeNamed():
                    self._name_airframe(event)
                case Notice():
                    sender = "log" if event.vehicle is None else f"vehicle {event.vehicle}"
                    self._say(event.time_s, "INFO", f"{sender}: {event.text}")

    def flush(self) -> None:
        """Write what is waiting, so that a viewer shows it."""
        for track in self._tracks.values():
            track.flush()
        self._flush_texts()

    def finish(self, assessment: Assessment) -> rrb.Blueprint:
        """Write what is left and the report, and return the layout of the whole flight."""
        for verdict in assessment.verdicts:
            self._track(verdict.vehicle, verdict.actuator)
        for track in self._tracks.values():
            track.finish()
        self._flush_texts()
        report = rr.TextDocument(markdown(assessment), media_type=rr.MediaType.MARKDOWN)
        self._stream.log("/report", report, static=True)
        lanes = []
        for verdict in assessment.ranked():
            track = self._track(verdict.vehicle, verdict.actuator)
            lanes.append(self._lane(track, verdict.condition, verdict.worst))
        return layout(lanes)

    def report_so_far(self) -> None:
        """Write what is known by now; not static, so that a viewer may forget the older ones."""
        rows = []
        for track in self.ranked():
            seen = track.latest
            evidence = (seen.friction_nm, seen.p_emergency) if seen else (None, None)
            condition = f"{track.held}, stale" if track.stale else track.held
            rows.append((self._title(track), condition, *evidence, track.since_s))
        text = so_far(rows)
        if text != self._report:
            self._report = text
            content = rr.TextDocument.columns(text=[text], media_type=[rr.MediaType.MARKDOWN])
            send(self._stream, "/report", [max(track.last_s for track in self.tracks)], content)

    def layout_so_far(self) -> rrb.Blueprint:
        """Return the layout that follows the flight, the worst actuator first."""
        return layout([self._lane(track, track.held, track.worst) for track in self.ranked()], live=True)

    def shape(self) -> object:
        """Return what the layout depends on: where it stays the same, so does the layout."""
        return [(track.root, track.held, frozenset(track.present)) for track in self.ranked()]

    def ranked(self) -> list[Track]:
        """Return the tracks, the worst first."""
        order: tuple[Condition, ...] = ("emergency", "degraded", "undecided", "normal")
        return sorted(self._tracks.values(), key=lambda track: order.index(track.held))

    def _lane(self, track: Track, condition: Condition, worst: Condition) -> Lane:
        return Lane(track.root, self._title(track), condition, worst, frozenset(track.present))

    def _title(self, track: Track) -> str:
        several = len({vehicle for vehicle, _ in self._tracks}) > 1
        return f"{track.vehicle}: {track.actuator}" if several else track.actuator

    def _name_airframe(self, event: AirframeNamed) -> None:
        self._say(event.time_s, "INFO", f"judged by the airframe profile {event.airframe.name}")
        for part in event.airframe.actuators:
            if part.limits is not None:
                self._limits[event.vehicle, part.name] = part.limits, event.time_s

    def _track(self, vehicle: int | None, actuator: str) -> Track:
        key = (vehicle, actuator)
        if key not in self._tracks:
            track = self._tracks[key] = Track(self._stream, vehicle, actuator)
            track.limits = self._limits.get(key) or self._limits.get((None, actuator))
        return self._tracks[key]

    def _say(self, time_s: float, level: str, text: str) -> None:
        self._texts.append((time_s, level, text))
        if len(self._texts) >= _TEXTS_PER_CHUNK:
            self._flush_texts()

    def _flush_texts(self) -> None:
        rows, self._texts = self._texts, []
        if rows:
            content = rr.TextLog.columns(text=[row[2] for row in rows], level=[row[1] for row in rows])
            send(self._stream, "/events", [row[0] for row in rows], content)


def _change(event: ConditionChanged) -> str:
    who = f"{event.actuator} (vehicle {event.vehicle})"
    return f"{who}: {event.before} → {event.after} since {clock(event.since_s)}: {event.rule}"
