"""The command ``live``: feeds the engine from links."""

from __future__ import annotations

import gc
import logging
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import FrameType
from typing import IO, TYPE_CHECKING, Any, NamedTuple, Self, cast

import click

from mavhums.cli.options import KEEP, PATH, STORE, judging
from mavhums.cli.output import complain, say
from mavhums.core.about import EPILOG
from mavhums.core.errors import ExitCode, MavhumsError

if TYPE_CHECKING:
    from rich.console import Console

    from mavhums.app.settings import Options
    from mavhums.live.outlet import Spool
    from mavhums.live.session import Session
    from mavhums.live.setup import LiveOptions
    from mavhums.live.sinks import DrawingSink
    from mavhums.results.assessment import Assessment

_LOG = logging.getLogger(__name__)
_PATIENCE_S = 0.5  # for readers that stall
_LEVELS = ("debug", "info", "warning", "error")


@click.command(short_help="Judge every actuator while it flies.", epilog=EPILOG)
@click.argument("urls", nargs=-1, metavar="URL...")
@judging(without=["aircraft", "store", "keep"])
@click.option("--aircraft", metavar="NAME", help="Name of the aircraft. Default: whose board it reports.")
@STORE
@KEEP
@click.option(
    "--record",
    type=PATH,
    metavar="FILE",
    help="Record what is accepted as a new .tlog; FILE may hold the time: flight-%Y%m%d-%H%M%S.tlog.",
)
@click.option("--alerts", is_flag=True, help="Send alerts to the ground station over the links.")
@click.option("--alerts-to", metavar="URL", help="Send alerts to the ground station at this address instead.")
@click.option(
    "--component",
    type=click.IntRange(1, 250),
    default=194,
    help="Component id of the sender of alerts and heartbeats.",
)
@click.option(
    "--silent",
    is_flag=True,
    help="Send nothing but alerts. Without a heartbeat an autopilot may hold back named values or more.",
)
@click.option(
    "--viewer",
    is_flag=False,
    flag_value="window",
    metavar="[MODE]",
    help="Follow in a Rerun viewer: window (default), browser, web (serve a page), serve, or the URL of one.",
)
@click.option("--no-position", is_flag=True, help="Do not draw the aircraft's position.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object per event, a line each.")
@click.option(
    "--duration",
    type=click.FloatRange(0, min_open=True),
    metavar="S",
    help="Stop after this many seconds. Default: run until Ctrl-C, SIGTERM or SIGHUP.",
)
@click.option(
    "--log-level",
    type=click.Choice(_LEVELS),
    default="warning",
    help="Which messages go to the standard error.",
)
def live(options: Options, duration: float | None, log_level: str, as_json: bool, **given: Any) -> None:
    """Follow MAVLink links and judge every actuator while it flies.

    \b
    URL:
      udpin:[HOST:]PORT     listen; without HOST on this computer's loopback only
      udpout:HOST:PORT      go to a port that answers
      tcp:HOST:PORT         connect to a server, again whenever the connection breaks
      serial:DEVICE[:BAUD]  a radio or an autopilot, 57600 baud by default

    \b
    Examples:
      mavhums live udpin:14550
      mavhums live udpin:14550 --record flight-%Y%m%d-%H%M%S.tlog --alerts
      mavhums live serial:/dev/ttyACM0:115200 --json | tee events.jsonl

    Each actuator is also compared with its aircraft's earlier flights in the store; --keep adds the recording
    to them at the end, as `mavhums analyse --keep` does.

    Ctrl-C, SIGTERM and SIGHUP end the session and print the verdicts. Exit codes are those of analyse.
    Neither recording nor judging waits for an output: unread output is dropped and counted.
    """
    if given["viewer"] and ":" in given["viewer"] and "://" not in given["viewer"]:
        given |= {"urls": (given["viewer"], *given["urls"]), "viewer": "window"}
    if not given["urls"]:
        raise click.UsageError("name a link, for example udpin:14550")
    store, keep, aircraft = (given.pop(name) for name in ("store", "keep", "aircraft"))
    if keep and given["record"] is None:
        raise click.UsageError("--keep needs --record FILE")
    judging = replace(options, store=store, aircraft=f"={aircraft}" if aircraft else None)
    if keep:  # a store that cannot be written is known before the flight
        from mavhums.flights.store import Store

        kept = Store(store)
        with kept.writing():
            judging = replace(judging, store=kept)
    from mavhums.live.outlet import Spool
    from mavhums.live.setup import LiveOptions

    out, err = Spool(sys.stdout, "standard output"), Spool(sys.stderr, "standard error", report=None)
    shows = _Outputs(given.pop("viewer"), not given.pop("no_position"), as_json)
    wanted = LiveOptions(judging=judging, **given)
    with StopSignal(duration) as stop:
        try:
            assessment, shown = _follow(wanted, shows, log_level, stop, (out, err))
        finally:
            written = out.finish(time.monotonic() + _PATIENCE_S)
            if out.outlet.dropped:
                _LOG.warning("%s: %d dropped", out.outlet.name, out.outlet.dropped)
            written = err.finish(time.monotonic() + _PATIENCE_S / 2) and written
    code = _kept(assessment, judging) if keep else assessment.exit_code
    if not (shown and written):
        os._exit(code)  # a hanging thread would delay an orderly end
    raise SystemExit(code)


def _kept(assessment: Assessment, judging: Options) -> ExitCode:
    """Put the recording of a session into the store; return the exit code of the command."""
    from mavhums.app.analysis import analyse

    log, code = Path(assessment.log.path or ""), assessment.exit_code
    try:
        if not log.is_file() or not log.stat().st_size:
            remedy = "check the link: the report above lists what was received"
            raise MavhumsError(f"{log}: nothing was recorded, so nothing is kept", remedy)
        analyse(log, judging, keep=True)
    except MavhumsError as error:
        complain(error)
        return code if code in (ExitCode.EMERGENCY, ExitCode.DEGRADED) else ExitCode.ERROR
    say(f"mavhums: {log} is kept in {judging.store}", err=True)
    return code


class _Outputs(NamedTuple):
    """What the user sees of a session: a viewer, and JSON or text."""

    viewer: str | None
    position: bool
    as_json: bool


def _follow(
    options: LiveOptions, shows: _Outputs, level: str, stop: StopSignal, outputs: tuple[Spool, Spool]
) -> tuple[Assessment, bool]:
    """Run a session with its displays; return its verdicts, and whether every viewer received its end."""
    from rich.console import Console

    from mavhums.live.setup import prepare

    out, err = outputs
    console = Console(file=cast("IO[str]", out))
    watched = console.is_terminal and not shows.as_json
    _log(level, err, console if watched else None)
    alone = not (shows.viewer or options.record or options.alerts or options.alerts_to)
    with ExitStack() as exits:
        drawn = _drawn(shows, exits) if shows.viewer else []
        session = prepare(options, drawn, vehicle_states=bool(drawn))
        session.status.outlets += [out.outlet, err.outlet, *(one.outlet for one in drawn)]
        gc.collect()
        gc.freeze()  # objects from the start-up cost the collector 0.1 s in flight, and a second at the end
        stop.begun = True

        def ended() -> bool:  # what only the standard output shows ends with its reader
            return stop() or (alone and out.outlet.gone)

        if shows.as_json:
            assessment = _write_json(session, options, ended, console)
        else:
            assessment = _show_until_end(session, ended, console, watched=watched)
        exits.pop_all()
    finished = [one.finish() for one in drawn]
    return assessment, all(finished)


def _drawn(shows: _Outputs, exits: ExitStack) -> list[DrawingSink]:
    """Open the viewer."""
    from mavhums.live.sinks import DrawingSink
    from mavhums.show.viewer import LiveViewer

    mode = shows.viewer or "window"
    viewer = LiveViewer(mode, recording_id=f"live-{time.time_ns():x}", position=shows.position)
    drawing = exits.enter_context(ExitStack())
    drawing.enter_context(viewer)
    if mode != "window":
        click.echo(f"viewer: {viewer.url}", err=True)
    return [DrawingSink(viewer, "viewer", drawing.close, patience_s=_PATIENCE_S)]


def _write_json(
    session: Session, options: LiveOptions, ended: Callable[[], bool], console: Console
) -> Assessment:
    from mavhums.live.sinks import JsonLines

    lines = JsonLines(partial(click.echo, file=console.file), session.clock.now_us, session.status)
    names = [str(link.address) for link in session.links]
    airframe, signed_only = options.judging.airframe, options.judging.key is not None
    lines.start(names, airframe=None if airframe is None else str(airframe), signed_only=signed_only)
    session.sinks.append(lines)
    return session.run(ended)


def _show_until_end(
    session: Session, ended: Callable[[], bool], console: Console, *, watched: bool
) -> Assessment:
    from mavhums.live.sinks import PlainLines
    from mavhums.show.terminal import render

    names = ", ".join(str(link.address) for link in session.links)
    write = partial(click.echo, file=console.file)
    if watched:
        from mavhums.live.sinks import View

        session.sinks.append(View(console, names))
    else:
        session.sinks.append(PlainLines(write))
        write(f"listening: {names}")
    assessment = session.run(ended)
    render(assessment, console)
    if session.recorder is not None:
        console.print(f"recorded: {session.recorder.path}", highlight=False)
    return assessment


def _log(level: str, err: Spool, console: Console | None) -> None:
    """Send messages to standard error; above the table if one is shown."""
    handler: logging.Handler = logging.StreamHandler(err)
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    if console is not None:
        from rich.logging import RichHandler

        handler = RichHandler(console=console, show_path=False)
    logger = logging.getLogger("mavhums")
    logger.handlers = [handler]
    logger.setLevel(level.upper())


class StopSignal:
    """Returns whether to stop: after a time, at Ctrl-C, SIGTERM or SIGHUP; a second signal aborts.

    Until ``begun``, there is nothing to end in order, and a signal ends the program at once. SIGHUP stays
    ignored if the program was started with it ignored (``nohup``).

    Parameters
    ----------
    duration
        Seconds; None for no limit.
    """

    def __init__(self, duration: float | None) -> None:
        self.begun = False
        self._stopped = False
        self._end = None if duration is None else time.monotonic() + duration
        self._before: dict[int, Any] = {}

    def __call__(self) -> bool:
        """Return whether to stop."""
        return self._stopped or (self._end is not None and time.monotonic() >= self._end)

    def __enter__(self) -> Self:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            left_alone = name == "SIGHUP" and number and signal.getsignal(number) is signal.SIG_IGN
            if number is not None and not left_alone:
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self._stopped or not self.begun:
            before = self._before[number]
            (before if callable(before) else signal.default_int_handler)(number, frame)
        self._stopped = True
