"""The friction of each actuator over its flights, as a Rerun recording."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from mavhums.core.conditions import URGENCY
from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.core.output import written_whole

if TYPE_CHECKING:
    import pandas as pd
    import rerun as rr
    import rerun.blueprint as rrb

__all__ = ["record_trend"]

_TIMELINE = "utc"


def record_trend(trend: pd.DataFrame, path: str | os.PathLike[str], *, report: str = "") -> None:
    """Write the recording of a fleet's or an aircraft's trend.

    Parameters
    ----------
    trend
        One row for each actuator and flight: ``actuator``, ``start_utc`` (ISO 8601 or a time stamp with its
        zone), ``friction_nm``, ``friction_low_nm``, ``friction_high_nm``, ``condition``,
        ``normal_limit_nm`` and ``emergency_limit_nm``; unknown values are NaN. The optional column
        ``vehicle`` distinguishes actuators of the same name.
    path
        The ``.rrd`` to write.
    report
        Markdown shown beside it, for example the number of flights left.

    Raises
    ------
    MissingExtraError
        If rerun is not installed.
    MavhumsError
        If the file cannot be written.

    Examples
    --------
    >>> import pandas as pd
    >>> row = {"actuator": "elevator", "start_utc": "2026-01-01T09:00:00Z", "condition": "normal"}
    >>> row |= {"friction_nm": 0.23, "friction_low_nm": 0.21, "friction_high_nm": 0.25}
    >>> row |= {"normal_limit_nm": 0.375, "emergency_limit_nm": 0.875}
    >>> record_trend(pd.DataFrame([row]), "trend.rrd")  # doctest: +SKIP
    """
    import pandas as pd

    try:
        from mavhums.show._stream import open_stream
    except ImportError as error:
        raise MissingExtraError("writing a recording", "viewer") from error
    known = trend.assign(start_utc=pd.to_datetime(trend["start_utc"], utc=True, format="ISO8601"))
    groups = ["vehicle", "actuator"] if "vehicle" in known else ["actuator"]
    with written_whole(Path(path)) as temporary, open_stream("trend") as stream:
        try:
            stream.save(temporary)
        except RuntimeError as error:
            problem = f"cannot write {path}: {str(error).replace(str(temporary), str(path))}"
            raise MavhumsError(problem, "choose another place") from error
        stream.send_recording_name("friction over flights")
        roots: list[tuple[int, str]] = []
        for names, flights in known.sort_values("start_utc").groupby(groups, sort=False):
            *vehicle, actuator = names if isinstance(names, tuple) else (names,)
            root = _draw(stream, [*(f"vehicle_{number}" for number in vehicle), str(actuator)], flights)
            roots.append((-URGENCY[flights["condition"].iloc[-1]], root))
        if report:
            import rerun as rr

            stream.log("/report", rr.TextDocument(report, media_type=rr.MediaType.MARKDOWN), static=True)
        stream.send_blueprint(
            _layout([root for _, root in sorted(roots)], bool(report)), make_active=True, make_default=True
        )
        stream.flush()


def _draw(stream: rr.RecordingStream, names: list[str], flights: pd.DataFrame) -> str:
    """Draw one actuator, and return its entity path."""
    import rerun as rr

    from mavhums.show.words import BLUE, COLOURS, PALE_BLUE

    root: str = rr.new_entity_path(names)
    index = [rr.TimeColumn(_TIMELINE, timestamp=flights["start_utc"].to_numpy("datetime64[ns]"))]
    states = rr.StateConfiguration(
        values=list(COLOURS), labels=list(COLOURS), colors=[(*rgb, 255) for rgb in COLOURS.values()]
    )
    stream.log(root, states, static=True)
    stream.send_columns(root, index, rr.StateChange.columns(state=flights["condition"].tolist()), strict=True)
    limits = flights[["normal_limit_nm", "emergency_limit_nm"]].to_numpy(float)
    for leaf, rows, style in (
        (
            "friction",
            flights[["friction_nm", "friction_low_nm", "friction_high_nm"]].to_numpy(float),
            rr.SeriesLines(
                names=["friction", "low (95 %)", "high (95 %)"],
                colors=[BLUE, PALE_BLUE, PALE_BLUE],
                widths=[2.5, 1, 1],
            ),
        ),
        (
            "limits",
            limits,
            rr.SeriesLines(
                names=[f"normal up to {limits[-1, 0]:g}", f"emergency from {limits[-1, 1]:g}"],
                colors=[COLOURS["degraded"], COLOURS["emergency"]],
                widths=[2, 2],
            ),
        ),
    ):
        stream.log(f"{root}/{leaf}", style, static=True)
        stream.send_columns(f"{root}/{leaf}", index, rr.Scalars.columns(scalars=rows), strict=True)
    points = rr.SeriesPoints(names="flight", colors=BLUE, markers="circle", marker_sizes=4)
    stream.log(f"{root}/flights", points, static=True)
    each = flights["friction_nm"].to_numpy(float)
    stream.send_columns(f"{root}/flights", index, rr.Scalars.columns(scalars=each), strict=True)
    return root


def _layout(roots: list[str], report: bool) -> rrb.Blueprint:
    import rerun.blueprint as rrb

    from mavhums.show.blueprint import panels, whole_flight

    lanes = rrb.StateTimelineView(
        origin="/", contents=roots, name="Condition at the end of each flight", time_view=whole_flight()
    )
    plots = [
        rrb.TimeSeriesView(
            origin="/",
            contents=[f"{root}/{leaf}" for leaf in ("friction", "limits", "flights")],
            name=f"{root.strip('/')}: friction, N·m",
            axis_x=whole_flight(),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=root == roots[0]),
        )
        for root in roots
    ]
    share = min(0.075 + 0.0385 * len(roots), 0.5)
    left = rrb.Vertical(lanes, rrb.Grid(*plots), row_shares=[share, 1 - share])
    text = rrb.TextDocumentView(origin="/report", name="Report")
    return rrb.Blueprint(
        rrb.Horizontal(left, text, column_shares=[3, 1]) if report else left,
        *panels(_TIMELINE),
        auto_views=False,
        auto_layout=False,
    )
