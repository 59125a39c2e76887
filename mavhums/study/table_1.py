"""Table 1 of the paper beside the characteristics of the simulated actuator."""

from __future__ import annotations

import numpy as np
import pandas as pd

from mavhums.study.published import TABLE_1
from mavhums_sim.ema import DataSheet, EmaParameters
from mavhums_sim.motion import CONTROL_PERIOD_S, simulate

__all__ = ["table_1"]

_HEALTHY_NM = 0.225


def table_1() -> pd.DataFrame:
    """Return the paper's characteristics, those of the simulated actuator, and how they were determined."""
    sheet, parameters = DataSheet(), EmaParameters.from_data_sheet(integral_gain=400.0)
    steps = round(2.0 / CONTROL_PERIOD_S)
    none, friction = np.zeros(steps), np.full(steps, _HEALTHY_NM)
    slew = simulate(parameters, np.full(steps, parameters.stroke), friction, none, none)
    ramp = np.radians(20.0) * np.arange(steps) * CONTROL_PERIOD_S
    lift = simulate(parameters, ramp, friction, none, np.full(steps, sheet.nominal_torque_nm))
    farthest = simulate(parameters, np.full(steps, np.radians(90.0)), friction, none, none)
    stall = parameters.torque_per_ampere * parameters.current_limit - _HEALTHY_NM
    ours = [
        (lift.load[-1], "load lifted at 20 °/s"),
        (stall, "torque at the current limit, less T_c"),
        (np.degrees(np.median(slew.speed[steps // 20 : steps // 5])), "simulated slew without load"),
        (np.degrees(farthest.angle[-1]), "simulated, commanded 90°"),
        (parameters.supply_voltage, "taken over"),
        (lift.current[-steps // 2 :].mean(), "simulated at the nominal torque, moving"),
        (sheet.mass_kg, "copied from the paper; not used"),
    ]
    return pd.DataFrame(
        {
            "characteristic": list(TABLE_1),
            "paper": list(TABLE_1.values()),
            "simulated": [float(value) for value, _ in ours],
            "how": [how for _, how in ours],
        }
    )
