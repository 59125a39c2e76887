"""The servo outputs: pulses, and the parameters that define the function of each output."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mavhums_sim._arrays import Array
from mavhums_sim.closed_loop.autopilot import Autopilot
from mavhums_sim.closed_loop.flight import FlownLoop
from mavhums_sim.closed_loop.surfaces import LAYOUTS
from mavhums_sim.closed_loop.tables import Table, whole

_INTEGER, _REAL = 6, 9
_CHANNELS = 8


@dataclass(frozen=True, slots=True, eq=False)
class Outputs:
    """The operator's configuration of the outputs: surfaces first, then the throttle.

    Attributes
    ----------
    trim, half_range
        Neutral pulse, and the range to either end, µs, shape (n,); ``half_range`` is ``travel`` rad.
    reversed_
        Whether the pulse decreases with a positive demand, shape (n,).
    """

    trim: Array
    half_range: Array
    reversed_: NDArray[np.bool_]
    travel: float

    @classmethod
    def of(cls, flown: FlownLoop) -> Outputs:
        """Return the outputs of a flight's airframe."""
        flight = flown.flight
        count = len(LAYOUTS[flight.layout].surfaces)
        travel = Autopilot().travel
        if flight.emas is not None:
            return cls(np.full(count, 1500.0), np.full(count, 500.0), np.zeros(count, bool), np.radians(60.0))
        if flight.airframe is None:
            return cls(np.full(count, 1500.0), np.full(count, 500.0), np.zeros(count, bool), travel)
        rng = np.random.default_rng([flight.airframe, 29])
        trim = 1500.0 + 5.0 * np.rint(rng.uniform(-8.0, 8.0, count))
        half = np.full(count, float(rng.choice([350.0, 400.0, 450.0])))
        return cls(trim, half, rng.random(count) < 0.3, travel)

    def pulses(self, flown: FlownLoop) -> NDArray[np.int64]:
        """Return the pulses of all frames, µs, surfaces first, then the throttle; shape (n, outputs)."""
        sign = np.where(self.reversed_, -1.0, 1.0) * self._px4_sign(flown)
        surfaces = self.trim + sign * self.half_range * flown.servos("demand") / self.travel
        throttle = 1000.0 + 1000.0 * flown.column("throttle")
        return whole(np.column_stack([surfaces, throttle]), 800, 2200)

    def at_rest(self) -> NDArray[np.int64]:
        """Return the pulses before the launch, shape (outputs,)."""
        return whole(np.append(self.trim, 1000.0))

    def _px4_sign(self, flown: FlownLoop) -> Array:
        """PX4 lets a positive output raise a left aileron's rolling moment to the left."""
        layout = LAYOUTS[flown.flight.layout]
        px4 = flown.flight.flavour == "px4"
        return np.array([-1.0 if px4 and kind == 1 else 1.0 for kind in layout.px4_types])

    def parameters(self, flown: FlownLoop) -> Table:
        """Return the PARAM_VALUE messages of the configuration, sent once from 2 s on."""
        rows = self._px4(flown) if flown.flight.flavour == "px4" else self._ardupilot(flown)
        values = np.array([value for _, value, _ in rows], dtype="<f4")
        if flown.flight.flavour == "px4":
            whole_numbers = np.array([int(value) for _, value, _ in rows], dtype="<i4").view("<f4")
            values = np.where([kind == _INTEGER for *_, kind in rows], whole_numbers, values)
        columns = {
            "param_id": np.array([name.encode() for name, *_ in rows], "S16"),
            "param_value": values,
            "param_type": np.array([kind for *_, kind in rows]),
            "param_count": len(rows),
            "param_index": np.arange(len(rows)),
        }
        return Table("PARAM_VALUE", 2.0 + 0.01 * np.arange(len(rows), dtype=np.float64), columns)

    def _ardupilot(self, flown: FlownLoop) -> list[tuple[str, float, int]]:
        layout = LAYOUTS[flown.flight.layout]
        functions = (*layout.functions, 70) + (0,) * (_CHANNELS - len(layout.functions) - 1)
        rows: list[tuple[str, float, int]] = [("FORMAT_VERSION", 13, 4), ("MIXING_GAIN", 0.5, _REAL)]
        rows += [("ARSPD_TYPE", 1, 2), ("ARSPD_USE", 1, 2), ("AIRSPEED_CRUISE", 25, _REAL)]
        for s, function in enumerate(functions):
            surface = s < len(layout.functions)
            trim = float(self.trim[s]) if surface else 1500.0 if function == 0 else 1000.0
            half = float(self.half_range[s]) if surface else 500.0
            low, high = (trim - half, trim + half) if surface else (1000.0, 2000.0)
            turned = float(self.reversed_[s]) if surface else 0.0
            for key, value, kind in (
                ("FUNCTION", function, 4),
                ("MIN", low, 4),
                ("MAX", high, 4),
                ("TRIM", trim, 4),
                ("REVERSED", turned, 2),
            ):
                rows.append((f"SERVO{s + 1}_{key}", float(value), kind))
        return rows

    def _px4(self, flown: FlownLoop) -> list[tuple[str, float, int]]:
        layout = LAYOUTS[flown.flight.layout]
        count = len(layout.surfaces)
        sign = self._px4_sign(flown)
        rows: list[tuple[str, float, int]] = [
            ("CA_AIRFRAME", 1, _INTEGER),
            ("CA_SV_CS_COUNT", count, _INTEGER),
        ]
        for s, kind in enumerate(layout.px4_types):
            rows.append((f"CA_SV_CS{s}_TYPE", kind, _INTEGER))
            rows.append((f"CA_SV_CS{s}_TRIM", 0.0, _REAL))
            for axis, name in enumerate("RPY"):
                rows.append((f"CA_SV_CS{s}_TRQ_{name}", sign[s] * layout.mixing[s][axis], _REAL))
        functions = [201 + s for s in range(count)] + [101] + [0] * (_CHANNELS - count - 1)
        for s, function in enumerate(functions):
            trim, half = (self.trim[s], self.half_range[s]) if s < count else (1500.0, 500.0)
            rows.append((f"PWM_MAIN_FUNC{s + 1}", function, _INTEGER))
            rows.append((f"PWM_MAIN_MIN{s + 1}", trim - half, _INTEGER))
            rows.append((f"PWM_MAIN_MAX{s + 1}", trim + half, _INTEGER))
        mask = sum(1 << s for s in range(count) if self.reversed_[s])
        rows += [
            ("PWM_MAIN_REV", mask, _INTEGER),
            ("SYS_AUTOSTART", 2106, _INTEGER),
            ("MAV_TYPE", 1, _INTEGER),
        ]
        return rows
