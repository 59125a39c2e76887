"""The messages that the aircraft sends in a closed-loop flight, as ArduPlane or PX4 does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mavhums_sim._arrays import Array
from mavhums_sim.closed_loop.aircraft import FRAME_S
from mavhums_sim.closed_loop.flight import FlownLoop
from mavhums_sim.closed_loop.frame import ERRORS
from mavhums_sim.closed_loop.mission import PHASES
from mavhums_sim.closed_loop.outputs import Outputs
from mavhums_sim.closed_loop.tables import Columns, Table, boot_ms, boot_us, text_rows, whole
from mavhums_sim.link import BOOT_US, EPOCH_US
from mavhums_sim.sensors import sample_times

ARDUPLANE_MODES = dict(zip(PHASES, (10, 10, 12, 7, 5, 10), strict=True))
PX4_MODES = dict(
    zip(PHASES, (0x02040000, 0x04040000, 0x03040000, 0x00030000, 0x00070000, 0x06040000), strict=True)
)
"""Custom modes while a phase is flown."""

_FIXED_WING, _ARDUPILOT, _PX4 = 1, 3, 12
_ARMED, _BASE_MODE = 128, 89
_SENSORS = 0x20 | 0b01011  # MAV_SYS_STATUS_SENSOR: gyro, accelerometer, absolute pressure, GPS
_AIRSPEED_SENSOR = 0x10
_ARMING_S = 4.0
_HOME_DEG, _HOME_M, _METRES_PER_DEGREE = (47.0, 8.0), 420.0, 111_320.0
_STANDING = {"pitch": 0.15, "z_force": -9.70, "x_force": 1.46, "height": 8.0}
_UNITS = {"accelerometer": 0.25, "gyro": 0.004, "gyro_bias": 0.003, "gps_m": 0.6, "climb": 0.15}


@dataclass(frozen=True, slots=True)
class Streams:
    """Messages per second.

    Attributes
    ----------
    rate
        SERVO_OUTPUT_RAW, ATTITUDE, IMU, VFR_HUD, position, demands.
    status
        SYS_STATUS and GPS_RAW_INT.
    parameters
        Whether the parameters are in the log.
    airspeed
        Whether the aircraft has an airspeed sensor; without it, it reports its speed over ground instead.

    Raises
    ------
    ValueError
        If a rate is outside 0.5…50 Hz.
    """

    rate: float = 10.0
    status: float = 2.0
    parameters: bool = True
    airspeed: bool = True

    def __post_init__(self) -> None:
        for name in ("rate", "status"):
            if not 0.5 <= getattr(self, name) <= 50.0:
                raise ValueError(f"streams: {name} {getattr(self, name):g} Hz is outside 0.5…50 Hz")


def report(flown: FlownLoop, streams: Streams | None = None) -> list[Table]:
    """Return all messages of a flight; for the first ``ground_s`` the aircraft is on the launcher.

    Examples
    --------
    >>> from mavhums_sim.closed_loop import ClosedLoop, fly_closed_loop
    >>> tables = report(fly_closed_loop(ClosedLoop(duration_s=30.0)), Streams(rate=4.0))
    >>> [table.times.size for table in tables if table.name == "ATTITUDE"]
    [119]
    """
    return _Reporter(flown, streams or Streams()).tables()


class _Reporter:
    """Samples the flight at the times of each stream."""

    def __init__(self, flown: FlownLoop, streams: Streams) -> None:
        self._flown, self._streams = flown, streams
        self._px4 = flown.flight.flavour == "px4"
        self._outputs = Outputs.of(flown)
        self._bias = _UNITS["gyro_bias"] * np.random.default_rng([flown.flight.seed, 30]).standard_normal(3)
        self._time = flown.time_s

    def tables(self) -> list[Table]:
        parts = [self._heartbeat(), *self._about(), self._servo(), self._attitude(), self._imu(), self._hud()]
        parts += [self._position(), self._gps(), self._status(), self._demand()]
        if self._px4:
            parts.append(self._landed())
        else:
            parts.append(self._second_imu())
        if self._streams.parameters:
            parts.append(self._outputs.parameters(self._flown))
        return parts

    def _times(self, stream: int, rate: float | None = None) -> tuple[Array, np.random.Generator]:
        rng = np.random.default_rng([self._flown.flight.seed, 31, stream])
        times = sample_times(rng, self._flown.end_s, rate or self._streams.rate)
        return times, rng

    def _at(self, times: Array, name: str) -> Array:
        """Return a column at the times, linear between frames and constant on the launcher."""
        column = self._flown.column(name)
        if name == "yaw":
            column = np.unwrap(column)
        sampled = np.interp(times, self._time, column)
        return np.where(
            times < self._time[0], _STANDING.get(name, 0.0 if name != "yaw" else column[0]), sampled
        )

    def _held(self, times: Array, values: Any) -> Any:
        """Return the values of the autopilot's last cycle at the times."""
        index = np.clip(((times - self._time[0]) / FRAME_S).astype(np.int64), 0, values.shape[0] - 1)
        flying = times >= self._time[0]
        return np.where(flying[:, None] if values.ndim == 2 else flying, values[index], 0)

    def _error(self, times: Array, name: str) -> Array:
        column = self._flown.errors[: (self._time.size + 1) // 2, ERRORS.index(name)]
        return np.interp(times, self._time[0] + 2 * FRAME_S * np.arange(column.size), column)

    def _modes(self, times: Array) -> NDArray[np.int64]:
        table = PX4_MODES if self._px4 else ARDUPLANE_MODES
        codes = np.array([table[phase] for phase in PHASES])
        phase = self._held(times, self._flown.column("phase")).astype(np.int64)
        return np.asarray(np.where(times < self._time[0], codes[0], codes[phase]), dtype=np.int64)

    def _heartbeat(self) -> Table:
        times = np.arange(0.3, self._flown.end_s, 1.0)
        armed = times > self._time[0] - _ARMING_S
        columns = {
            "type": _FIXED_WING,
            "autopilot": _PX4 if self._px4 else _ARDUPILOT,
            "base_mode": _BASE_MODE + _ARMED * armed,
            "custom_mode": self._modes(times),
            "system_status": np.where(armed, 4, 3),
            "mavlink_version": 3,
        }
        return Table("HEARTBEAT", times, columns)

    def _about(self) -> list[Table]:
        unique = 0x4D48_0000 + (self._flown.flight.airframe or 0)
        board = np.zeros((1, 18), dtype=np.uint8)
        board[0, :4] = np.frombuffer(unique.to_bytes(4, "big"), np.uint8)
        version = {"capabilities": 0xF, "flight_sw_version": 0x040507FF, "uid": unique, "uid2": board}
        texts = [(1.0, "PX4 1.15.4" if self._px4 else "ArduPlane V4.5.7")]
        texts.append((max(self._time[0] - _ARMING_S, 1.5), "Armed" if self._px4 else "Throttle armed"))
        return [Table("AUTOPILOT_VERSION", np.array([1.5]), version), text_rows(texts)]

    def _servo(self) -> Table:
        times, _ = self._times(0)
        pulses = self._held(times, self._outputs.pulses(self._flown))
        pulses = np.where((times < self._time[0])[:, None], self._outputs.at_rest(), pulses)
        columns: Columns = {f"servo{s + 1}_raw": pulses[:, s] for s in range(pulses.shape[1])}
        columns["time_usec"] = boot_us(times) % 2**32
        return Table("SERVO_OUTPUT_RAW", times, columns)

    def _attitude(self) -> Table:
        times, rng = self._times(1)
        columns: Columns = {"time_boot_ms": boot_ms(times)}
        for name in ("roll", "pitch"):
            columns[name] = self._at(times, name) + self._error(times, name)
        columns["yaw"] = (self._at(times, "yaw") + np.pi) % (2 * np.pi) - np.pi
        for name, axis in (("rollspeed", "p"), ("pitchspeed", "q"), ("yawspeed", "r")):
            columns[name] = self._at(times, axis) + _UNITS["gyro"] * rng.standard_normal(times.size)
        return Table("ATTITUDE", times, columns)

    def _sensed(self, times: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return specific force, m/s², and rates, rad/s, shape (n, 3) each."""
        shape = (times.size, 3)
        force = np.stack([self._at(times, f"{axis}_force") for axis in "xyz"], axis=1)
        rates = np.stack([self._at(times, axis) for axis in "pqr"], axis=1)
        force = force + _UNITS["accelerometer"] * rng.standard_normal(shape)
        return force, rates + self._bias + _UNITS["gyro"] * rng.standard_normal(shape)

    def _imu(self) -> Table:
        times, rng = self._times(2)
        force, rates = self._sensed(times, rng)
        if not self._px4:
            return Table("RAW_IMU", times, {"time_usec": boot_us(times), **_milli(force, rates)})
        columns: Columns = {"time_usec": boot_us(times), "fields_updated": 0x1FFF, "temperature": 35.0}
        for k, axis in enumerate("xyz"):
            columns[f"{axis}acc"], columns[f"{axis}gyro"] = force[:, k], rates[:, k]
        columns["abs_pressure"] = 964.0 - 0.115 * self._at(times, "height")
        columns["pressure_alt"] = _HOME_M + self._at(times, "height")
        return Table("HIGHRES_IMU", times, columns)

    def _second_imu(self) -> Table:
        times, rng = self._times(3)
        return Table(
            "SCALED_IMU2", times, {"time_boot_ms": boot_ms(times), **_milli(*self._sensed(times, rng))}
        )

    def _hud(self) -> Table:
        times, rng = self._times(4)
        speed = np.hypot(self._at(times, "north_speed"), self._at(times, "east_speed"))
        sensed = self._held(times, self._flown.column("measured_airspeed"))
        columns = {
            "airspeed": np.maximum(sensed, 0.0) if self._streams.airspeed else speed,
            "groundspeed": speed,
            "heading": whole(np.degrees(self._at(times, "yaw")) % 360.0, 0, 359),
            "throttle": whole(100.0 * self._held(times, self._flown.column("throttle")), 0, 100),
            "alt": _HOME_M + self._at(times, "height"),
            "climb": -self._at(times, "down_speed") + _UNITS["climb"] * rng.standard_normal(times.size),
        }
        return Table("VFR_HUD", times, columns)

    def _place(self, times: Array, rng: np.random.Generator, deviation: float) -> tuple[Array, Array]:
        """Return latitude and longitude, 1e-7 °, with the drift of a lost GPS."""
        north, east = self._at(times, "north"), self._at(times, "east")
        north = north + deviation * rng.standard_normal(times.size) + self._drift(times)
        latitude = _HOME_DEG[0] + north / _METRES_PER_DEGREE
        scale = _METRES_PER_DEGREE * np.cos(np.radians(_HOME_DEG[0]))
        return latitude * 1e7, (_HOME_DEG[1] + east / scale) * 1e7

    def _lost(self, times: Array) -> NDArray[np.bool_]:
        lost = np.zeros(times.size, dtype=bool)
        for confounder in self._flown.flight.confounders:
            if confounder.kind == "gps":
                lost |= (times >= confounder.at_s) & (times < confounder.until_s)
        return lost

    def _drift(self, times: Array) -> Array:
        drift = np.zeros(times.size)
        for confounder in self._flown.flight.confounders:
            if confounder.kind == "gps":
                drift += confounder.value * np.clip(
                    times - confounder.at_s, 0.0, confounder.until_s - confounder.at_s
                )
        return drift

    def _position(self) -> Table:
        times, rng = self._times(5)
        latitude, longitude = self._place(times, rng, 0.1)
        height = 1000.0 * self._at(times, "height")
        columns = {
            "time_boot_ms": boot_ms(times),
            "lat": np.rint(latitude),
            "lon": np.rint(longitude),
            "alt": np.rint(height + 1000.0 * _HOME_M),
            "relative_alt": np.rint(height),
            "vx": whole(100.0 * self._at(times, "north_speed")),
            "vy": whole(100.0 * self._at(times, "east_speed")),
            "vz": whole(100.0 * self._at(times, "down_speed")),
            "hdg": whole(np.degrees(self._at(times, "yaw")) % 360.0 * 100.0, 0, 35999),
        }
        return Table("GLOBAL_POSITION_INT", times, columns)

    def _gps(self) -> Table:
        times, rng = self._times(6, self._streams.status)
        latitude, longitude = self._place(times, rng, _UNITS["gps_m"])
        north, east = self._at(times, "north_speed"), self._at(times, "east_speed")
        lost = self._lost(times)
        columns = {
            "time_usec": boot_us(times) if self._px4 else EPOCH_US - BOOT_US + boot_us(times),
            "fix_type": np.where(lost, 1, 3),
            "lat": np.rint(latitude),
            "lon": np.rint(longitude),
            "alt": np.rint(1000.0 * (_HOME_M + self._at(times, "height"))),
            "eph": np.where(lost, 9999, 80),
            "epv": np.where(lost, 9999, 120),
            "vel": whole(100.0 * np.hypot(north, east), 0, 65535),
            "cog": whole(np.degrees(np.arctan2(east, north)) % 360.0 * 100.0, 0, 35999),
            "satellites_visible": np.where(lost, 0, 14),
        }
        return Table("GPS_RAW_INT", times, columns)

    def _status(self) -> Table:
        times, rng = self._times(7, self._streams.status)
        current = 2.0 + 40.0 * self._held(times, self._flown.column("throttle")) ** 2
        columns: Columns = {
            "load": whole(300.0 + 20.0 * rng.standard_normal(times.size), 0, 1000),
            "voltage_battery": whole(1000.0 * (46.0 - 0.02 * current - times * 2e-4), 0, 65535),
            "current_battery": whole(100.0 * current),
            "battery_remaining": whole(100.0 - times / 90.0, 0, 100),
        }
        sensors = _SENSORS | _AIRSPEED_SENSOR * self._streams.airspeed
        columns |= {f"onboard_control_sensors_{name}": sensors for name in ("present", "enabled", "health")}
        return Table("SYS_STATUS", times, columns)

    def _demand(self) -> Table:
        """NAV_CONTROLLER_OUTPUT of ArduPlane, ATTITUDE_TARGET of PX4."""
        times, _ = self._times(8)

        def held(name: str) -> Array:
            return np.asarray(self._held(times, self._flown.column(name)), dtype=np.float64)

        if self._px4:
            quaternion = _quaternion(held("nav_roll"), held("nav_pitch"), self._at(times, "yaw"))
            rates = {f"body_{axis}_rate": held(f"{axis}_rate") for axis in ("roll", "pitch", "yaw")}
            columns = {"time_boot_ms": boot_ms(times), "q": quaternion, "thrust": held("throttle"), **rates}
            return Table("ATTITUDE_TARGET", times, columns)
        heading = np.degrees(self._at(times, "yaw"))
        bearing = (heading + np.degrees(held("course_error")) + 180.0) % 360.0 - 180.0
        columns = {
            "nav_roll": np.degrees(held("nav_roll")),
            "nav_pitch": np.degrees(held("nav_pitch")),
            "nav_bearing": whole(bearing),
            "target_bearing": whole(bearing),
            "alt_error": held("height_error"),
            "aspd_error": 100.0 * held("speed_error"),
        }
        return Table("NAV_CONTROLLER_OUTPUT", times, columns)

    def _landed(self) -> Table:
        times = np.arange(0.4, self._flown.end_s, 1.0)
        return Table("EXTENDED_SYS_STATE", times, {"landed_state": np.where(times < self._time[0], 1, 2)})


def _milli(force: Array, rates: Array) -> Columns:
    """Return accelerations in mG and rates in mrad/s."""
    columns: Columns = {f"{axis}acc": whole(force[:, k] / 9.80665e-3) for k, axis in enumerate("xyz")}
    columns |= {f"{axis}gyro": whole(1000.0 * rates[:, k]) for k, axis in enumerate("xyz")}
    return columns


def _quaternion(roll: Array, pitch: Array, yaw: Array) -> Array:
    """Return w, x, y, z of the attitude, shape (n, 4)."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a / 2), np.sin(a / 2)) for a in (roll, pitch, yaw))
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=1,
    )
