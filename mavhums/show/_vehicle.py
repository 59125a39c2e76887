"""One vehicle's part of a recording: airframe, attitude, position and flight mode."""

from __future__ import annotations

from typing import Final

import numpy as np
import rerun as rr

from mavhums.engine.events import Attitude, FlightMode, Position
from mavhums.show._craft import Craft
from mavhums.show._stream import send
from mavhums.show._thin import Thinner
from mavhums.show.words import BLUE

__all__ = ["Vehicle"]

_SHADES: Final = ((74, 86, 130), (104, 84, 128), (70, 108, 128), (96, 96, 112))
_CAPACITY: Final = 8192
_PATH_EVERY_S: Final = 5.0


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
        name = "no_vehicle" if vehicle is None else f"vehicle_{vehicle}"
        self.craft = Craft(stream, vehicle)
        self.mode_path: str | None = None
        self.position_path: str | None = None
        self.extent_deg: float | None = None
        self.turns = False
        self._name = name
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
