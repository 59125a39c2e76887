"""Drawing of a whole flight on a Rerun stream, to a file or a viewer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

import rerun as rr
import rerun.blueprint as rrb

from mavhums.actuator.mapping import AirframeNamed, Samples
from mavhums.actuator.profile import Airframe
from mavhums.core.conditions import URGENCY, Condition
from mavhums.engine.events import Event, Notice
from mavhums.health.actuator.detectors import detectors_for
from mavhums.health.decision.events import Classified, ConditionChanged, Indication, Trace, Window
from mavhums.results.assessment import Assessment
from mavhums.show._craft import Vehicle, craft_path
from mavhums.show._signals import RowWriter
from mavhums.show._tracks import Track, path_part
from mavhums.show.blueprint import Lane, Surroundings, layout
from mavhums.show.event_words import FRAME, event_words
from mavhums.show.headline import judged_vehicles
from mavhums.show.markdown_report import markdown
from mavhums.show.outline import motors, surfaces
from mavhums.show.tables import listed
from mavhums.show.words import clock, name
from mavhums.vehicle.states import Attitude, FlightMode, Position

_LEVELS: Final[dict[str, str]] = {"degraded": "WARN", "emergency": "ERROR"}
_LOGGED: Final = frozenset({"mode", "crash", "failsafe", "supply", "reboot"})
"""Kinds of events that come as modes, texts or notices, too, and are logged as these."""


class Scene:
    """Draws the engine's events.

    Parameters
    ----------
    stream
        Output stream.
    live
        Whether a viewer shows the flight live.
    position
        Whether to draw the vehicle's position.
    """

    def __init__(self, stream: rr.RecordingStream, *, live: bool, position: bool) -> None:
        self._rows, self._position = RowWriter(stream, live=live), position
        self._airframes: dict[int | None, Airframe] = {}
        self._vehicles: dict[int | None, Vehicle] = {}
        self._tracks: dict[tuple[int | None, str], Track] = {}
        self._frames: dict[int, Track] = {}
        self._state_s = 0.0

    @property
    def tracks(self) -> list[Track]:
        """Tracks of the actuators, in order of first appearance."""
        return list(self._tracks.values())

    @property
    def last_s(self) -> float:
        """Flight time of the latest data."""
        return max(self._state_s, *(track.last_s for track in self._tracks.values()), 0.0)

    def consume(self, events: Iterable[Event]) -> None:
        """Process the engine's events, in order."""
        for event in events:
            match event:
                case Trace() if event.actuator == FRAME:
                    if event.vehicle not in self._frames:
                        self._frames[event.vehicle] = self._new_track(event.vehicle, FRAME)
                    self._frames[event.vehicle].trace(event)
                case Samples() | Window() | Indication() | Trace() | Classified():
                    self._track(event.vehicle, event.actuator).take(event)
                case ConditionChanged():
                    self._track(event.vehicle, event.actuator).changed(event)
                    self._log_text(event.time_s, _LEVELS.get(event.after, "INFO"), _change(event))
                case AirframeNamed():
                    self._name_airframe(event)
                case Attitude():
                    self._state_s = float(event.time_s[-1])
                    self._vehicle(event.vehicle).attitude(event.time_s, event.roll_pitch_yaw_rad)
                case FlightMode():
                    self._vehicle(event.vehicle).mode(event)
                    self._log_text(event.time_s, "INFO", f"vehicle {event.vehicle}: flight mode {event.mode}")
                case Position():
                    if self._position:
                        self._vehicle(event.vehicle).position(event)
                case Notice():
                    sender = "log" if event.vehicle is None else f"vehicle {event.vehicle}"
                    self._log_text(event.time_s, "INFO", f"{sender}: {event.text}")
        for track in self._tracks.values():
            track.now(self.last_s)

    def flush(self) -> None:
        """Write buffered data, so that a viewer shows them."""
        for track in self._tracks.values():
            track.flush()
        for vehicle in self._vehicles.values():
            vehicle.flush()
        self._rows.flush()

    def finish(self, assessment: Assessment) -> rrb.Blueprint:
        """Write remaining data and the report, and return the layout of the whole flight."""
        for verdict in assessment.verdicts:
            self._track(verdict.vehicle, verdict.actuator)
        self._fit(assessment)
        for track in self._tracks.values():
            track.now(assessment.log.duration_s)
        for verdict in assessment.verdicts:
            self._track(verdict.vehicle, verdict.actuator).conclude(verdict)
        for track in self._tracks.values():
            track.finish()
        for vehicle in self._vehicles.values():
            vehicle.finish()
        for happened in assessment.events:
            if happened.kind not in _LOGGED:
                text = f"vehicle {happened.vehicle}: {event_words(happened)}"
                self._log_text(happened.time_s, "INFO", text)
        for track in self._tracks.values():
            if track.reference_s:
                begin, end = map(clock, track.reference_s)
                text = f"{track.actuator}: its reference is learned from {begin} to {end}"
                self._log_text(track.reference_s[1], "INFO", f"{text} (vehicle {track.vehicle})")
        report = rr.TextDocument(markdown(assessment), media_type=rr.MediaType.MARKDOWN)
        self._rows.style("/report", report)
        lanes = list(self._lanes(assessment))
        self._rows.finish()
        return layout(lanes, self._surroundings())

    def _fit(self, assessment: Assessment) -> None:
        """Draw what is not drawn by a profile, and give each part to the track whose condition it has.

        Which output drives which motor or surface is known at the end.
        """
        for vehicle in dict.fromkeys(verdict.vehicle for verdict in assessment.verdicts):
            bearings, found = motors(assessment, vehicle), surfaces(assessment, vehicle)
            owners = {name: part.verdict.actuator for name, part in found.items()}
            craft = self._vehicle(vehicle).craft
            if bearings and not craft.parts:
                craft.fit_motors(bearings)
            elif found and not craft.parts:
                craft.fit({name: part.text for name, part in found.items()})
            for track in self._tracks.values():
                if track.vehicle == vehicle:
                    track.parts = [one for one in craft.parts if owners.get(one, one) == track.actuator]

    def _lanes(self, assessment: Assessment) -> Iterator[Lane]:
        """Yield the lanes in the order of the report; none for what nothing reports on.

        The viewer sorts lanes by their paths, so each is drawn once more under a path that begins with its
        rank, which is not known before the end.
        """
        shown = [one for one in listed(judged_vehicles(assessment)[0]) if one.gravest != "unmonitored"]
        for rank, verdict in enumerate(shown, 1):
            track = self._track(verdict.vehicle, verdict.actuator)
            path = f"/condition/{rank}_{path_part(name(verdict, assessment))}"
            track.lane(path)
            yield self._lane(track, verdict.condition, verdict.worst)._replace(states=path)
        judged = {(verdict.vehicle, verdict.actuator) for verdict in assessment.verdicts}
        for key, track in self._tracks.items():
            if "thrust" in track.traces and key not in judged:  # a motor beside one that failed
                yield self._lane(track, track.condition, track.worst)

    def live_shape(self) -> tuple[list[Lane], Surroundings]:
        """Return what determines the layout for live use, with the worst actuator first."""
        lanes = [self._lane(track, track.condition, track.worst) for track in self.ranked()]
        return lanes, self._surroundings()

    def ranked(self) -> list[Track]:
        """Return the tracks, worst first."""
        return sorted(self._tracks.values(), key=lambda track: -URGENCY[track.condition])

    def _lane(self, track: Track, condition: Condition, worst: Condition) -> Lane:
        frame = self._frames.get(track.vehicle or 0) if "thrust" in track.traces else None
        traces = track.traces | (frame.traces if frame else {})
        shown = (track.present, dict(track.faults), track.cause, traces)
        return Lane(track.root, self._title(track), condition, worst, *shown)

    def _title(self, track: Track) -> str:
        several = len({vehicle for vehicle, _ in self._tracks}) > 1
        return f"{track.vehicle}: {track.actuator}" if several else track.actuator

    def _surroundings(self) -> Surroundings:
        """Return what is drawn besides the actuators; with several vehicles, the worst one's airframe."""
        fitted = [v for v in self._vehicles.values() if v.craft.parts]
        worst = {track.vehicle for track in self.ranked()[:1]}
        fitted.sort(key=lambda vehicle: vehicle.craft.root not in {craft_path(number) for number in worst})
        return Surroundings(
            modes=tuple(v.mode_path for v in self._vehicles.values() if v.mode_path),
            airframe=fitted[0].craft.root if fitted else None,
            positions=tuple(v.position_path for v in self._vehicles.values() if v.position_path),
            extent_deg=max((v.extent_deg for v in self._vehicles.values() if v.extent_deg), default=None),
        )

    def _name_airframe(self, event: AirframeNamed) -> None:
        self._log_text(event.time_s, "INFO", f"judged by the airframe profile {event.airframe.name}")
        self._airframes[event.vehicle] = event.airframe

    def _vehicle(self, number: int | None) -> Vehicle:
        if number not in self._vehicles:
            self._vehicles[number] = Vehicle(self._rows, number)
        return self._vehicles[number]

    def _track(self, vehicle: int | None, actuator: str) -> Track:
        key = (vehicle, actuator)
        if key not in self._tracks:
            self._tracks[key] = self._new_track(vehicle, actuator)
            self._equip(self._tracks[key])
        return self._tracks[key]

    def _new_track(self, vehicle: int | None, actuator: str) -> Track:
        others = {track.root for track in self._tracks.values()}
        return Track(self._rows, vehicle, actuator, self._vehicle(vehicle).craft, others)

    def _equip(self, track: Track) -> None:
        """Set a track's limits and its surface in the airframe from the profile."""
        airframe = self._airframes.get(track.vehicle) or self._airframes.get(None)
        if airframe is None:
            return
        track.axis_limits = airframe.axes
        for part in airframe.actuators:
            if part.name == track.actuator:
                track.detectors = {detector.fault: detector for detector in detectors_for(part)}
                craft = self._vehicle(track.vehicle).craft
                if not craft.parts:
                    craft.fit({one.name: f"{one.surface} {one.name}" for one in airframe.actuators})
                track.parts = [track.actuator]

    def _log_text(self, time_s: float, level: str, text: str) -> None:
        self._rows.put("/events", [time_s], rr.TextLog.columns, text=[text], level=[level])


def _change(event: ConditionChanged) -> str:
    """Describe a change, most important first for narrow views; the previous event has the old condition."""
    why = event.rule.removeprefix(f"{event.after}: ")
    since = f"{event.after} since {clock(event.since_s)}"
    return f"{event.actuator}: {since}, {why} (vehicle {event.vehicle})"
