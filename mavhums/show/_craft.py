"""One vehicle's part of a recording: its airframe in 3-D, its attitude, its position and its flight mode.

The surfaces or motors of the airframe have the colour of their condition.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import rerun as rr

from mavhums.core.arrays import Array
from mavhums.core.quantities import column
from mavhums.show._signals import RowWriter
from mavhums.show.curves import Thinner
from mavhums.show.outline import V_TAIL, kind, places
from mavhums.show.words import BLUE, YELLOW
from mavhums.vehicle.states import FlightMode, Position

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
_HULL: Final[tuple[_Box, ...]] = (
    ((-0.12, 0, 0), (0.75, 0.06, 0.06), _GREY),
    ((0.66, 0, -0.01), (0.07, 0.035, 0.035), _DARK),
    ((0, 0, 0.03), (0.16, 1.0, 0.016), _GREY),
)
"""Fuselage, nose and wing."""
_FIN: Final[_Box] = ((-0.77, 0, 0.2), (0.09, 0.012, 0.18), _GREY)
_TAILPLANE: Final[_Box] = ((-0.77, 0, 0.03), (0.09, 0.4, 0.012), _GREY)
_HUB: Final[tuple[_Box, ...]] = (
    ((0, 0, 0), (0.2, 0.2, 0.05), _GREY),
    ((0.26, 0, 0), (0.06, 0.04, 0.03), _DARK),
)
_V1, _V3 = column("V1"), column("V3")


def vehicle_part(vehicle: int | None) -> str:
    """Return a vehicle as part of an entity path."""
    return "no_vehicle" if vehicle is None else f"vehicle_{vehicle}"


def craft_path(vehicle: int | None) -> str:
    """Return the entity path of a vehicle's airframe; it has the heading, ``body`` the attitude."""
    return rr.new_entity_path(["airframe", vehicle_part(vehicle)])


class CraftModel:
    """The 3-D airframe of one vehicle, whose parts have the colours of their conditions.

    Attributes
    ----------
    root
        Its entity path.
    parts
        Entity paths of the surfaces or motors, by their names.
    """

    def __init__(self, rows: RowWriter, vehicle: int | None) -> None:
        self.root = craft_path(vehicle)
        self.parts: dict[str, str] = {}
        self._rows = rows
        self._shape: type[rr.Boxes3D | rr.Ellipsoids3D] = rr.Boxes3D

    def fit(self, texts: Mapping[str, str]) -> None:
        """Draw an airframe with surfaces by name, each with a text that says where it is."""
        kinds = [*map(kind, texts.values())]
        fin = (_FIN,) if "rudder" in kinds or V_TAIL not in kinds else ()
        self._hull(*_HULL, *fin, *(() if V_TAIL in kinds else (_TAILPLANE,)))
        for name, place in zip(texts, places([*texts.values()]), strict=True):
            begin, end = place.span
            box = rr.Boxes3D(
                centers=[
                    (-place.chord / 2, side * (begin + end) / 2, 0) for side in (1, -1)[: 1 + place.mirrored]
                ],
                half_sizes=[(place.chord / 2, abs(end - begin) / 2 - 0.006, _THICK)],
                fill_mode="solid",
                labels=[name],
                show_labels=len(texts) <= _LABELLED,
            )
            hinge = rr.RotationAxisAngle((1, 0, 0), degrees=place.roll)
            at = rr.Transform3D(translation=(place.x, 0, place.z), rotation_axis_angle=hinge)
            self._rows.style(self._new_part(name, box).rpartition("/")[0], at)

    def fit_motors(self, bearings_deg: Mapping[str, float]) -> None:
        """Draw a multirotor with motors by their names and where they sit, clockwise from the nose."""
        self._shape = rr.Ellipsoids3D
        turns = -np.radians([*bearings_deg.values()])  # the scene's third axis is up
        tips = _ARM * np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
        arms = rr.LineStrips3D([[(0, 0, 0), tip] for tip in tips], radii=0.02, colors=_GREY)
        self._rows.style(f"{self.root}/body/arms", arms)
        self._hull(*_HUB)
        radius = min(0.8 * _ARM * float(np.sin(np.pi / len(turns))), 0.4)
        for name, tip in zip(bearings_deg, tips, strict=True):
            disc = rr.Ellipsoids3D(
                centers=[tip + np.array([0, 0, 0.06])],
                half_sizes=[(radius, radius, _THICK)],
                fill_mode="solid",
                labels=[name],
                show_labels=True,
            )
            self._new_part(name, disc)

    def _new_part(self, name: str, shape: rr.Boxes3D | rr.Ellipsoids3D) -> str:
        self.parts[name] = self.root + rr.new_entity_path(["body", "at", name, "part"])
        self._rows.style(self.parts[name], shape)
        # Not static: the viewer shows what is static instead of what changes with time.
        self.colour(name, [0.0], [_GREY])
        return self.parts[name]

    def _hull(self, *boxes: _Box) -> None:
        centres, halves, colours = zip(*boxes, strict=True)
        hull = rr.Boxes3D(centers=centres, half_sizes=halves, colors=colours, fill_mode="solid")
        self._rows.style(f"{self.root}/body/hull", hull)

    def colour(self, name: str, time_s: Sequence[float], colours: Sequence[tuple[int, int, int]]) -> None:
        """Set the colours of a part, each from a flight time on."""
        if name in self.parts:
            self._rows.put(self.parts[name], time_s, self._shape.columns, colors=list(colours))

    def move(self, name: str, time_s: Array, values: Array) -> None:
        """Rotate a surface by V3, or by V1 if the log has no V3; positive is trailing edge down or left.

        Poses are at least 40 ms apart, which looks smooth.
        """
        measured = np.isfinite(values[:, _V3]).any()
        angle = values[:, _V3 if measured else _V1]
        known = np.flatnonzero(np.isfinite(angle))
        known = known[np.diff(np.floor(time_s[known] / _STEP_S), prepend=-1.0) != 0]
        if name in self.parts and known.size:
            turns = [rr.RotationAxisAngle((0, 1, 0), degrees=-degrees) for degrees in angle[known].tolist()]
            self._rows.put(self.parts[name], time_s[known], rr.Transform3D.columns, rotation_axis_angle=turns)

    def attitude(self, time_s: Array, roll_pitch_yaw_rad: Array) -> None:
        """Rotate the airframe; the heading is separate, so that a view can follow it."""
        roll, pitch, yaw = roll_pitch_yaw_rad.T
        heading = [rr.RotationAxisAngle((0, 0, 1), radians=-angle) for angle in yaw.tolist()]
        self._rows.put(self.root, time_s, rr.Transform3D.columns, rotation_axis_angle=heading)
        a, b = roll / 2, -pitch / 2
        turns = np.stack(
            [np.sin(a) * np.cos(b), np.cos(a) * np.sin(b), -np.sin(a) * np.sin(b), np.cos(a) * np.cos(b)],
            axis=1,
        )
        self._rows.put(f"{self.root}/body", time_s, rr.Transform3D.columns, quaternion=turns)


class Vehicle:
    """Draws a vehicle's attitude, position and flight mode.

    Attributes
    ----------
    craft
        Its airframe.
    mode_path, position_path
        Entity paths of its flight mode and of its position; None before either is known.
    attitude
        Takes times and attitudes.
    extent_deg
        Extent of the track, the larger of north–south and west–east; None before the end.
    """

    def __init__(self, rows: RowWriter, vehicle: int | None) -> None:
        self.craft = CraftModel(rows, vehicle)
        self.mode_path: str | None = None
        self.position_path: str | None = None
        self.extent_deg: float | None = None
        self._name = vehicle_part(vehicle)
        self._rows = rows
        self.attitude = rows.thinned(3, _CAPACITY, self.craft.attitude, "first")
        self._point = rows.thinned(2, _CAPACITY, self._draw_points, "first")
        self._positions = Thinner(2, _CAPACITY, "first")
        self._modes: list[str] = []
        self._seen_s, self._path_s = -np.inf, -_PATH_EVERY_S

    def position(self, event: Position) -> None:
        """Add positions."""
        if self.position_path is None:
            self.position_path = rr.new_entity_path(["position", self._name])
        degrees, self._seen_s = event.latitude_longitude_deg, float(event.time_s[-1])
        self._positions.add(event.time_s, degrees)
        self._point(event.time_s, degrees)

    def _draw_points(self, time_s: Array, degrees: Array) -> None:
        shown = {"radii": np.full(len(degrees), -6.0), "colors": [YELLOW] * len(degrees)}
        self._rows.put(str(self.position_path), time_s, rr.GeoPoints.columns, positions=degrees, **shown)

    def mode(self, event: FlightMode) -> None:
        """Add a change of flight mode."""
        if self.mode_path is None:
            self.mode_path = rr.new_entity_path(["flight_mode", self._name])
        if event.mode not in self._modes:
            self._modes.append(event.mode)
            shades = [(*_SHADES[k % len(_SHADES)], 255) for k in range(len(self._modes))]
            states = rr.StateConfiguration(values=self._modes, labels=self._modes, colors=shades)
            self._rows.style(self.mode_path, states)
        self._rows.put(self.mode_path, [event.time_s], rr.StateChange.columns, state=[event.mode])

    def flush(self) -> None:
        """Draw the path so far, every few seconds of flight."""
        if self._seen_s >= self._path_s + _PATH_EVERY_S:
            self._path_s = self._seen_s
            time, degrees = self._positions.rows()
            line = {"line_strings": [degrees], "colors": [BLUE], "radii": [-1.5]}
            self._rows.put(f"{self.position_path}/path", time[-1:], rr.GeoLineStrings.columns, **line)

    def finish(self) -> None:
        """Draw the whole path."""
        time, degrees = self._positions.rows()
        if time.size:
            line = rr.GeoLineStrings(lat_lon=[degrees], colors=[BLUE], radii=[-1.5])
            self._rows.style(f"{self.position_path}/path", line)
            self.extent_deg = float(np.ptp(degrees, axis=0).max())
