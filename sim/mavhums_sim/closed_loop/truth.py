"""The ground truth of a closed-loop flight."""

from __future__ import annotations

from math import inf, isnan

import numpy as np

from mavhums_sim.closed_loop.flight import FlownLoop
from mavhums_sim.closed_loop.mission import PHASES
from mavhums_sim.closed_loop.outputs import Outputs
from mavhums_sim.closed_loop.reports import ARDUPLANE_MODES, PX4_MODES
from mavhums_sim.closed_loop.surfaces import LAYOUTS
from mavhums_sim.link import BOOT_US

_BOOT_S = BOOT_US / 1e6


def truth(flown: FlownLoop) -> dict[str, object]:
    """Return the flight's description and its faults as plain data; times are s since boot.

    Examples
    --------
    >>> from mavhums_sim.closed_loop import ClosedLoop, SurfaceFault, fly_closed_loop
    >>> fault = SurfaceFault("rudder", "freeze", at_s=25.0)
    >>> known = truth(fly_closed_loop(ClosedLoop(duration_s=30.0, faults=(fault,))))
    >>> known["faults"][0]["kind"], known["faults"][0]["begin_boot_s"]
    ('freeze', 55.0)
    """
    flight = flown.flight
    return {
        "seed": flight.seed,
        "airframe_seed": flight.airframe,
        "model": "aerosonde (Beard and McLain)",
        "layout": flight.layout,
        "autopilot": flight.flavour,
        "mission": flight.mission,
        "wind": {"speed": flight.air.wind, "from_deg": flight.air.direction_deg},
        "turbulence": flight.air.turbulence,
        "launch_boot_s": _BOOT_S + flight.ground_s,
        "end_boot_s": round(_BOOT_S + flown.end_s, 3),
        "end": flown.end,
        "faults": [_fault(flown, index) for index in range(len(flight.faults))],
        "confounders": [
            {"kind": c.kind, "value": c.value, **_span(c.at_s, c.until_s)} for c in flight.confounders
        ],
        "phases": _phases(flown),
        **({"emas": flown.emas.truth()} if flown.emas else {}),
    }


def _fault(flown: FlownLoop, index: int) -> dict[str, object]:
    fault = flown.flight.faults[index]
    servo = LAYOUTS[flown.flight.layout].surfaces.index(fault.surface)
    row = min(int(np.searchsorted(flown.time_s, fault.at_s)), flown.log.shape[0] - 1)
    demand, angle = (np.degrees(flown.servos(what)[row, servo]) for what in ("demand", "surface"))
    return {
        "surface": fault.surface,
        "servo": servo + 1,
        "kind": fault.kind,
        "value": None if isnan(fault.value) else fault.value,
        "phase": PHASES[int(flown.column("phase")[row])],
        "demand_deg": round(float(demand), 2),
        "demand_us": Outputs.of(flown).pulses(flown)[row, servo].item(),
        "surface_deg": round(float(angle), 2),
        **_span(fault.at_s, fault.until_s),
    }


def _span(begin: float, end: float) -> dict[str, float | None]:
    return {"begin_boot_s": _BOOT_S + begin, "end_boot_s": None if end == inf else _BOOT_S + end}


def _phases(flown: FlownLoop) -> list[dict[str, object]]:
    phase = flown.column("phase").astype(np.int64)
    modes = PX4_MODES if flown.flight.flavour == "px4" else ARDUPLANE_MODES
    begins = np.concatenate([[0], np.flatnonzero(np.diff(phase)) + 1])
    return [
        {
            "phase": PHASES[phase[row]],
            "custom_mode": modes[PHASES[phase[row]]],
            "boot_s": round(_BOOT_S + float(flown.time_s[row]), 2),
        }
        for row in begins
    ]
