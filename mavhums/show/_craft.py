"""One vehicle's part of a recording: its airframe in 3-D, its attitude, its position and its flight mode.

The surfaces or motors of the airframe have the colour of their condition.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import rerun as rr

from mavhums.core.arrays import Array
from mavhums.core.quantities import KEYS
from mavhums.show._signals import send
from mavhums.show.evidence import Thinner
from mavhums.show.outline import V_TAIL, Place, kind, places
from mavhums.show.words import BLUE
from mavhums.vehicle.states import Attitude, FlightMode, Position

_SHADES: Final = ((74, 86, 130), (104, 84, 128), (70, 108, 128), (96, 96, 112))
_CAPACITY: Final = 8192
_PATH_EVERY_S: Final = 5.0

_GREY, _DARK = (126, 130, 138), (88, 92, 100)
_STEP_S: Final = 0.04
_THICK: Final = 0.014
_LABELLED: Final = 8
_ARM: Final = 0.7
_Point = tuple[float, float, float]
_Box = tuple[_Point, _Point, tuple[int, int, int]]  # centre, half its size, and colour
_V1, _V3 = KEYS.index("V1"), KEYS.index("V3")


def vehicle_part(vehicle: int | None) -> str:
    """Return a vehicle as part of an entity path."""
    return "no_vehicle" if vehicle is None else f"vehicle_{vehicle}"


def craft_path(vehicle: int | None) -> str:
    """Return the entity path of a vehicle's airframe; it has the heading, ``body`` the attitude."""
    return rr.new_entity_path(["airframe", vehicle_part(vehicle)])


class Part:
    """A part of an airframe that is drawn in the colour of its condition."""

    _shape: type[rr.Boxes3D | rr.Ellipsoids3D] = rr.Boxes3D

    def __init__(self, stream: rr.RecordingStream, path: str):
        self._stream, self._path = stream, path

    def move(self, time_s: Array, values: Array) -> None:
        """Do nothing, unless what the part is asked for is drawn as a movement."""

    def colour(self, time_s: Sequence[float], colours: Sequence[tuple[int, int, int]]) -> None:
        """Set the colours of the part's conditions, each from a flight time on."""
        send(self._stream, self._path, time_s, self._shape.columns(colors=list(colours)))


class Surface(Part):
    """One control surface, or another part that a servo moves."""

    def __init__(self, stream: rr.RecordingStream, path: str, name: str, place: Place, *, named: bool):
        super().__init__(stream, path)
        self._tick = -1.0
        begin, end = place.span
        sides = (1, -1) if place.mirrored else (1,)
        hinge = rr.Transform3D(
            translation=(place.x, 0, place.z),
            rotation_axis_angle=rr.RotationAxisAngle((1, 0, 0), degrees=place.roll),
        )
        box = rr.Boxes3D(
            centers=[(-place.chord / 2, side * (begin + end) / 2, 0) for side in sides],
            half_sizes=[(place.chord / 2, abs(end - begin) / 2 - 0.006, _THICK)],
            fill_mode="solid",
            labels=[name],
            show_labels=named,
        )
        stream.log(path.rsplit("/", 1)[0], hinge, static=True)
        stream.log(path, box, static=True)

    def move(self, time_s: Array, values: Array) -> None:
        """Rotate the surface by V3, or by V1 if the log has no V3; positive is trailing edge down or left.

        Poses are at least 40 ms apart, which looks smooth.
        """
        measured = np.isfinite(values[:, _V3]).any()
        angle = values[:, _V3 if measured else _V1]
        rows = np.flatnonzero(np.isfinite(angle))
        if rows.size:
            ticks = np.floor(time_s[rows] / _STEP_S)
            rows = rows[np.diff(ticks, prepend=self._tick) != 0]
            self._tick = float(ticks[-1])
        if rows.size:
            turns = [rr.RotationAxisAngle((0, 1, 0), degrees=-degrees) for degrees in angle[rows].tolist()]
            content = rr.Transform3D.columns(rotation_axis_angle=turns)
            send(self._stream, self._path, time_s[rows], content)


class Motor(Part):
    """One motor of a multirotor: an arm, and a disc."""

    _shape = rr.Ellipsoids3D

    def __init__(self, stream: rr.RecordingStream, path: str, name: str, bearing_deg: float, radius: float):
        super().__init__(stream, path)
        turn = -np.radians(bearing_deg)  # the scene's third axis is up
        ahead, left = float(np.cos(turn)), float(np.sin(turn))
        turned = rr.RotationAxisAngle((0, 0, 1), radians=float(turn))
        arm = rr.Boxes3D(
            centers=[(ahead * _ARM / 2, left * _ARM / 2, 0)], half_sizes=[(_ARM / 2, 0.025, 0.02)],
            rotation_axis_angles=[turned], colors=[_GREY], fill_mode="solid",
        )  # fmt: skip
        disc = rr.Ellipsoids3D(
            centers=[(ahead * _ARM, left * _ARM, 0.06)], half_sizes=[(radius, radius, _THICK)],
            fill_mode="solid", labels=[name], show_labels=True,
        )  # fmt: skip
        stream.log(path.rsplit("/", 1)[0], arm, static=True)
        stream.log(path, disc, static=True)
        # Not static: the viewer shows what is static instead of what changes with time.
        self.colour([0.0], [_GREY])


class Craft:
    """The 3-D airframe of one vehicle.

    Attributes
    ----------
    surfaces
        Surfaces by the actuator's name, motors by theirs.
    """

    def __init__(self, stream: rr.RecordingStream, vehicle: int | None) -> None:
        self.root = craft_path(vehicle)
        self.surfaces: dict[str, Part] = {}
        self._stream = stream

    def fit(self, surfaces: Mapping[str, str]) -> None:
        """Draw the airframe with surfaces by their names; a text names the place of each."""
        parts: dict[str, _Box] = {
            "fuselage": ((-0.12, 0, 0), (0.75, 0.06, 0.06), _GREY),
            "nose": ((0.66, 0, -0.01), (0.07, 0.035, 0.035), _DARK),
            "wing": ((0, 0, 0.03), (0.16, 1.0, 0.016), _GREY),
        }
        kinds = [*map(kind, surfaces.values())]
        if "rudder" in kinds or V_TAIL not in kinds:
            parts["fin"] = ((-0.77, 0, 0.2), (0.09, 0.012, 0.18), _GREY)
        if V_TAIL not in kinds:
            parts["tailplane"] = ((-0.77, 0, 0.03), (0.09, 0.4, 0.012), _GREY)
        self._draw_boxes(parts)
        for name, place in zip(surfaces, places([*surfaces.values()]), strict=True):
            path = self.root + rr.new_entity_path(["body", "at", name, "surface"])
            named = len(surfaces) <= _LABELLED
            self.surfaces[name] = Surface(self._stream, path, name, place, named=named)

    def fit_motors(self, bearings_deg: Mapping[str, float]) -> None:
        """Draw a multirotor with motors by their names and where they sit, clockwise from the nose."""
        self._draw_boxes(
            {
                "hub": ((0, 0, 0), (0.2, 0.2, 0.05), _GREY),
                "nose": ((0.26, 0, 0), (0.06, 0.04, 0.03), _DARK),
            }
        )
        radius = min(0.8 * _ARM * float(np.sin(np.pi / len(bearings_deg))), 0.4)
        for name, bearing in bearings_deg.items():
            path = self.root + rr.new_entity_path(["body", "at", name, "disc"])
            self.surfaces[name] = Motor(self._stream, path, name, bearing, radius)

    def _draw_boxes(self, boxes: Mapping[str, _Box]) -> None:
        for name, (centre, half, colour) in boxes.items():
            box = rr.Boxes3D(centers=[centre], half_sizes=[half], colors=[colour], fill_mode="solid")
            self._stream.log(f"{self.root}/body/{name}", box, static=True)

    def attitude(self, time_s: Array, roll_pitch_yaw_rad: Array) -> None:
        """Rotate the airframe; the heading is separate, so that a view can follow it."""
        roll, pitch, yaw = (roll_pitch_yaw_rad[:, k] for k in range(3))
        heading = [rr.RotationAxisAngle((0, 0, 1), radians=-angle) for angle in yaw.tolist()]
        send(self._stream, self.root, time_s, rr.Transform3D.columns(rotation_axis_angle=heading))
        a, b = roll / 2, -pitch / 2
        turns = np.stack(
            [np.sin(a) * np.cos(b), np.cos(a) * np.sin(b), -np.sin(a) * np.sin(b), np.cos(a) * np.cos(b)],
            axis=1,
        )
        send(self._stream, f"{self.root}/body", time_s, rr.Transform3D.columns(quaternion=turns))


class Vehicle:
    """Draws a vehicle's attitude, position and flight mode.

    Attributes
    ----------
    craft
        Its airframe.
    mode_path, position_path
        Entity paths of its flight mode and of its position; None before either is known.
    extent_deg
        Extent of the track, the larger of north–south and west–east; None before the end.
    """

    def __init__(self, stream: rr.RecordingStream, vehicle: int | None, *, live: bool) -> None:
        self.craft = Craft(stream, vehicle)
        self.mode_path: str | None = None
        self.position_path: str | None = None
        self.extent_deg: float | None = None
        self.turns = False
        self._name = vehicle_part(vehicle)
        self._stream, self._live = stream, live
        self._attitudes = Thinner(3, _CAPACITY, "first")
        self._positions = Thinner(2, _CAPACITY, "first")
        self._modes: list[str] = []
        self._path_s = -np.inf

    def attitude(self, event: Attitude) -> None:
        """Add attitudes."""
        self.turns = True
        if self._live:
            self.craft.attitude(event.time_s, event.roll_pitch_yaw_rad)
        else:
            self._attitudes.add(event.time_s, event.roll_pitch_yaw_rad)

    def position(self, event: Position) -> None:
        """Add positions."""
        if self.position_path is None:
            self.position_path = rr.new_entity_path(["position", self._name])
        self._positions.add(event.time_s, event.latitude_longitude_deg)
        if self._live:
            self._draw_positions(event.time_s, event.latitude_longitude_deg)
            if event.time_s[-1] >= self._path_s + _PATH_EVERY_S:
                self._path_s = float(event.time_s[-1])
                self._draw_path(static=False)

    def mode(self, event: FlightMode) -> None:
        """Add a change of flight mode."""
        if self.mode_path is None:
            self.mode_path = rr.new_entity_path(["flight_mode", self._name])
        if event.mode not in self._modes:
            self._modes.append(event.mode)
            shades = [(*_SHADES[k % len(_SHADES)], 255) for k in range(len(self._modes))]
            states = rr.StateConfiguration(values=self._modes, labels=self._modes, colors=shades)
            self._stream.log(self.mode_path, states, static=True)
        send(self._stream, self.mode_path, [event.time_s], rr.StateChange.columns(state=[event.mode]))

    def finish(self) -> None:
        """Write remaining data."""
        if self._live:
            return
        time, angles = self._attitudes.rows()
        if time.size:
            self.craft.attitude(time, angles)
        time, degrees = self._positions.rows()
        if time.size:
            self._draw_positions(time, degrees)
            self._draw_path(static=True)
            self.extent_deg = float(np.ptp(degrees, axis=0).max())

    def _draw_positions(self, time_s: np.ndarray, degrees: np.ndarray) -> None:
        content = rr.GeoPoints.columns(
            positions=degrees, radii=np.full(time_s.size, -6.0), colors=[(240, 228, 66)] * time_s.size
        )
        send(self._stream, str(self.position_path), time_s, content)

    def _draw_path(self, *, static: bool) -> None:
        time, degrees = self._positions.rows()
        line = rr.GeoLineStrings(lat_lon=[degrees], colors=[BLUE], radii=[-1.5])
        if static:
            self._stream.log(f"{self.position_path}/path", line, static=True)
        else:
            content = rr.GeoLineStrings.columns(line_strings=[degrees], colors=[BLUE], radii=[-1.5])
            send(self._stream, f"{self.position_path}/path", [float(time[-1])], content)
