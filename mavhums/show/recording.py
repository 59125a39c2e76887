"""A flight, or an aircraft's flights, as a Rerun recording."""

from __future__ import annotations

import os
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from mavhums.core.conditions import URGENCY
from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.core.output import WholeFile, written_whole
from mavhums.engine.events import Event
from mavhums.results.assessment import Assessment

if TYPE_CHECKING:
    import pandas as pd
    import rerun as rr
    import rerun.blueprint as rrb

    from mavhums.show._scene import Scene

_FOOTER, _FOOTER_SIZE = b"RRF2FOOT", 12
_WRITTEN_S = 60.0


class Recorder:
    """Writes the engine's events as an ``.rrd``, in bounded memory.

    Until :meth:`close` the recording is a hidden temporary file beside ``path``; leaving the
    ``with`` block without closing removes it, so ``path`` never holds an incomplete flight.

    Parameters
    ----------
    path
        The recording to write; an older one is replaced.
    recording_id
        What tells this flight from others; the same flight keeps the same.
    position
        Whether the recording may contain the aircraft's position.

    Raises
    ------
    MissingExtraError
        If rerun is not installed.

    Examples
    --------
    >>> with Recorder("flight.rrd", recording_id="6f1c") as recorder:  # doctest: +SKIP
    ...     recorder.consume(engine.feed(block))
    ...     recorder.close(engine.assessment())
    """

    def __init__(self, path: str | os.PathLike[str], *, recording_id: str, position: bool = True) -> None:
        self._path = Path(path)
        self._file: WholeFile | None = None
        self._stream, self._scene = draw(recording_id, position=position)

    def __enter__(self) -> Self:
        try:
            self._file = WholeFile(self._path)
            self._stream.save(self._file.temporary)
        except BaseException as error:  # a signal, too, must leave no part of a file
            self.__exit__(None, None, None)
            if isinstance(error, Exception):
                problem = f"cannot write {self._path}: {self._why(error)}"
                raise MavhumsError(problem, "choose another place") from error
            raise
        return self

    def _why(self, error: Exception) -> str:
        """Return what is wrong with the place, without the name of the temporary file in it."""
        if not self._path.parent.is_dir():
            return f"there is no folder {self._path.parent}"
        if isinstance(error, OSError) and error.strerror:
            return error.strerror
        return str(error).replace(str(self._file.temporary), str(self._path)) if self._file else str(error)

    def __exit__(self, *_: object) -> None:
        self._stream.disconnect()
        if self._file:
            self._file.discard()

    def consume(self, events: Iterable[Event]) -> None:
        """Take what the engine reports, in its order."""
        self._scene.consume(events)

    def close(self, assessment: Assessment) -> None:
        """Write the report, the properties and the layout, and put the recording in its place."""
        end(self._stream, self._scene, assessment, self._path.stem)
        if self._file:
            self._publish(self._file)

    def _publish(self, file: WholeFile) -> None:
        """Finish the temporary file, check it (rerun only logs write errors), and rename it."""
        try:
            # Without a limit Rerun may wait for ever for its writer, which ends when the disk is full.
            self._stream.flush(timeout_sec=_WRITTEN_S)
            self._stream.disconnect()
            with file.temporary.open("rb") as written:
                written.seek(-_FOOTER_SIZE, os.SEEK_END)
                if not written.read().startswith(_FOOTER):
                    raise OSError("its end is missing")
            file.publish()
        except (OSError, RuntimeError) as error:
            raise MavhumsError(f"cannot write {self._path}: {error}", "is the disk full?") from error


class PipedRecorder:
    """Writes the engine's events as a recording to the standard output, for a viewer that reads it.

    Parameters
    ----------
    recording_id
        What tells this flight from others.

    Raises
    ------
    MissingExtraError
        If rerun is not installed.
    """

    def __init__(self, *, recording_id: str) -> None:
        self._stream, self._scene = draw(recording_id)

    def __enter__(self) -> Self:
        self._stream.stdout()
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.disconnect()

    def consume(self, events: Iterable[Event]) -> None:
        """Take what the engine reports, in its order."""
        self._scene.consume(events)

    def close(self, assessment: Assessment) -> None:
        """Write the report, the properties and the layout."""
        end(self._stream, self._scene, assessment, "flight")
        self._stream.flush()


def check_viewer() -> None:
    """Raise before any long work where a recording cannot be written.

    Raises
    ------
    MissingExtraError
        If rerun is not installed.
    """
    try:
        import rerun  # noqa: F401  (only whether it can be imported)
    except ImportError as error:
        raise MissingExtraError("a recording or a live view", "viewer") from error


def draw(recording_id: str, *, live: bool = False, position: bool = True) -> tuple[rr.RecordingStream, Scene]:
    """Return a stream without a destination, and the scene that draws on it.

    Raises
    ------
    MissingExtraError
        If rerun is not installed.
    """
    check_viewer()
    from mavhums.show._rows import open_stream
    from mavhums.show._scene import Scene

    stream = open_stream(recording_id)
    return stream, Scene(stream, live=live, position=position)


def end(stream: rr.RecordingStream, scene: Scene, assessment: Assessment, name: str) -> None:
    """Draw the end of a flight, its report, its properties and the final layout."""
    blueprint = scene.finish(assessment)
    path = assessment.log.path
    _describe(stream, assessment, Path(path).name if path else name)
    stream.send_blueprint(blueprint, make_active=True, make_default=True)


def _describe(stream: rr.RecordingStream, assessment: Assessment, name: str) -> None:
    """Write the properties that identify a recording in a catalogue: vehicle, worst actuator, condition."""
    import rerun as rr

    log = assessment.log
    stream.send_recording_name(name)
    if log.start_utc:
        start = datetime.fromisoformat(log.start_utc)
        start = start if start.tzinfo else start.replace(tzinfo=UTC)
        stream.send_recording_start_time_nanos(round(start.timestamp() * 1e6) * 1000)
    properties: dict[str, Any] = {"notice": assessment.notice, "duration_s": log.duration_s}
    if assessment.airframe:
        properties["airframe"] = assessment.airframe
    if assessment.verdicts:
        worst = assessment.ranked()[0]
        properties |= {"worst_actuator": worst.actuator, "condition": worst.gravest}
        if worst.vehicle is not None:
            properties["vehicle"] = worst.vehicle
    stream.send_property("mavhums", rr.AnyValues(**properties))


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

    check_viewer()
    from mavhums.show._rows import open_stream

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
