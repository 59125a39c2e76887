"""The curves as JSON: the same series as in the report, with gaps and flight modes."""

from __future__ import annotations

import json

import numpy as np

from mavhums.show.curves import Curve
from mavhums.show.evidence import CaptionedCurve, Limit
from mavhums.show.html_plot import chart, flight_charts

HOSTILE = "AUTO\x1b[2J</script>"


def test_a_gap_is_a_gap_and_numbers_are_short_and_finite() -> None:
    time_s = np.concatenate([np.arange(10.0, 13.0), np.arange(200.0, 203.0)])
    value = np.full(6, 1 / 3)
    curve = Curve(time_s, np.stack([value - 0.1, value, value + 0.1], axis=1), value * np.nan)
    drawn = chart(curve, [Limit(1.0, "degraded above")], "a", "b")
    assert drawn["time"] == [10.0, 11.0, 12.0, 200.0, 200.0, 201.0, 202.0]
    assert drawn["value"] == [0.3333, 0.3333, 0.3333, None, 0.3333, 0.3333, 0.3333]
    assert drawn["demanded"] == [None] * 7
    assert drawn["range"][0] <= 0.2
    assert drawn["range"][1] >= 1.0
    assert drawn["limits"] == [{"value": 1.0, "name": "degraded above", "label": "degraded"}]
    json.dumps(drawn, allow_nan=False)
    assert None not in chart(curve, [], "a", "b", whole=True)["value"]


def test_modes_are_of_each_vehicle() -> None:
    modes = [(0.5, "MANUAL"), (20.0, HOSTILE)]
    curve = Curve(np.array([1.0, 2.0]), np.zeros((2, 3)))
    drawn = flight_charts([CaptionedCurve(1, HOSTILE, "caption", curve, modes=modes)], 30.0)
    (one,) = drawn["charts"]
    assert "\x1b" not in one["title"]
    assert (one["vehicle"], one["since"]) == (1, None)
    first, second = drawn["modes"][1]
    assert first == (0.5, 20.0, "MANUAL")
    assert second[:2] == (20.0, 30.0)
    assert "\x1b" not in second[2]
    assert len(json.dumps(drawn, allow_nan=False)) < 2000
