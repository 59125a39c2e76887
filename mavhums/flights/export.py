"""The verdicts of a store as one table, for spreadsheets, dashboards and other programs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mavhums.flights.queries import standings
from mavhums.flights.stores.delta import Store
from mavhums.results.standing import FlightsLeft, Standing
from mavhums.results.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["export"]

_READ: Final = "aircraft, path, sha256, start_us, vehicle, actuator, condition, worst, airframe, verdict"
_OF_FLIGHT: Final = (
    *("aircraft", "path", "sha256", "start_utc", "vehicle", "actuator", "condition", "worst", "finding"),
    *("estimate", "low", "high", "unit", "limit", "emergency", "suspect", "reason", "airframe"),
)
_LEFT: Final = ("flights_to_{}", "flights_to_{}_low", "flights_to_{}_high", "date_{}")
_OF_LAST: Final = (
    *("state", "state_since_utc", "grows", "growth_per_flight"),
    *(name.format(limit) for limit in ("degraded", "emergency") for name in _LEFT),
)
_NUMBERS: Final = (
    *("estimate", "low", "high", "limit", "emergency", "growth_per_flight"),
    *(name for name in _OF_LAST if name.startswith("flights_to")),
)


def export(store: str | os.PathLike[str], output: str | os.PathLike[str] | None = None) -> pd.DataFrame:
    """Return one row per verdict; also write them to a .csv or .parquet table if one is named.

    ``estimate`` with its 95 % interval ``low`` and ``high``, ``unit``, ``limit`` (degraded) and ``emergency``
    are of ``finding``: the suspected fault's indicator, else the friction, else an axis's effectiveness.

    The columns from ``state`` on tell how the actuator stands now, in the row of its last flight; they are
    empty in the others. ``state`` is the condition over its flights, ``grows`` what certainly grows, and
    ``flights_to_degraded`` and ``flights_to_emergency`` are its remaining useful life after that flight, with
    95 % interval; an empty high end means that it need not reach the limit. ``date_…`` is the expected day.

    Raises
    ------
    MavhumsError
        If the store does not exist, or the table cannot be written.
    """
    import pandas as pd

    from mavhums.core.files import written_whole
    from mavhums.core.table_writers import writer_for

    kept = Store(store).opened()
    now = {
        (aircraft, one.vehicle, one.actuator, one.log): one
        for aircraft, several in standings(kept).items()
        for one in several
    }
    answer = kept.query(f"SELECT {_READ} FROM verdicts ORDER BY aircraft, start_us, path, vehicle, actuator")
    rows: list[dict[str, object]] = []
    while several := answer.fetchmany(1_000):
        for each in several:
            row = dict(zip(_READ.split(", "), each, strict=True))
            stands = now.get((row["aircraft"], row["vehicle"] or 0, row["actuator"], row["path"]))
            rows.append(_of_flight(row) | (_of_last(stands) if stands else {}))
    frame = pd.DataFrame(rows, columns=[*_OF_FLIGHT, *_OF_LAST])
    frame = frame.astype(dict.fromkeys(_NUMBERS, float))
    frame["start_utc"] = pd.to_datetime(frame["start_utc"], unit="us", utc=True)
    if output is not None:
        writer = writer_for(Path(output))
        with written_whole(Path(output)) as temporary, writer(temporary) as table:
            table.write(frame)
    return frame


def _of_flight(row: dict[str, Any]) -> dict[str, object]:
    verdict = Verdict.model_validate_json(row.pop("verdict"))
    suspects = [one.fault for one in verdict.suspects]
    shown = {one.fault: one for one in verdict.indicators}
    fault = next((name for name in (*suspects, "friction", "effectiveness") if name in shown), None)
    one = shown[fault] if fault else None
    return {
        **row,
        "start_utc": row["start_us"],
        "finding": fault,
        **(one.value.model_dump() if one else {}),
        "unit": one.unit if one else None,
        "limit": one.limit if one else None,
        "emergency": one.emergency if one else None,
        "suspect": suspects[0] if suspects else None,
        "reason": verdict.reason,
    }


def _of_last(stands: Standing) -> dict[str, object]:
    growth = stands.growth
    told: dict[str, object] = {"state": stands.condition, "state_since_utc": stands.since_utc}
    if growth is None:
        return told
    told |= {"grows": growth.quantity, "growth_per_flight": growth.per_flight.estimate}
    return told | _left("degraded", growth.to_degraded) | _left("emergency", growth.to_emergency)


def _left(limit: str, left: FlightsLeft | None) -> dict[str, object]:
    if left is None:
        return {}
    values = (left.estimate, left.low, left.high, left.expected_utc)
    return dict(zip((name.format(limit) for name in _LEFT), values, strict=True))
