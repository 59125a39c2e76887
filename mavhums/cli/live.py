"""The command ``live``: the engine fed from links."""

from __future__ import annotations

import gc
import logging
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

from mavhums.cli.options import AIRFRAME, BASELINE_FROM, DIALECT, FALSE_ALARMS, HISTORY, KEY, PATH

if TYPE_CHECKING:
    from rich.console import Console

    from mavhums.live.session import Session
    from mavhums.live.viewer import Drawn
    from mavhums.report.assessment import Assessment

__all__ = ["live"]

_LEVELS = ("debug", "info", "warning", "error")


@click.command(epilog="Not an airworthiness decision; validated in simulation only.")
@click.argument("urls", nargs=-1, metavar="URL...")
@AIRFRAME
@click.option("--model", metavar="FILE", help="Model file. Default: the packaged one.")
@DIALECT
@FALSE_ALARMS
@HISTORY
@BASELINE_FROM
@KEY
@click.option(
    "--record",
    type=PATH,
    metavar="FILE",
    help="Record what is accepted as a new .tlog; FILE may hold the time: flight-%Y%m%d-%H%M%S.tlog.",
)
@click.option("--alerts", is_flag=True, help="Tell the ground station what is found, over the links.")
@click.option("--alerts-to", metavar="URL", help="Tell the ground station at this address instead.")
@click.option(
    "--component",
    type=click.IntRange(1, 250),
    default=194,
    show_default=True,
    help="Component id of the alerts' sender.",
)
@click.option(
    "--viewer",
    is_flag=False,
    flag_value="window",
    metavar="[MODE]",
    help="Follow in a Rerun viewer: window (default), browser, web (serve a page), serve, or the URL of one.",
)
@click.option(
    "--rrd", type=PATH, metavar="OUT", help="Write a Rerun recording as well; it appears at the end."
)
@click.option("--no-position", is_flag=True, help="Draw nothing of where the aircraft is.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object per event, a line each.")
@click.option(
    "--duration",
    type=click.FloatRange(0, min_open=True),
    metavar="S",
    help="Stop after this many seconds. Default: run until Ctrl-C or SIGTERM.",
)
@click.option("-v", "--verbose", is_flag=True, help="The same as --log-level info.")
@click.option(
    "--log-level",
    type=click.Choice(_LEVELS),
    default="warning",
    show_default=True,
    help="Which messages go to the standard error.",
)
def live(duration: float | None, verbose: bool, log_level: str, as_json: bool, **options: Any) -> None:
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

    Ctrl-C and SIGTERM end the session and print the verdicts. Exit codes are those of analyse.
    """
    if options["viewer"] and ":" in options["viewer"] and "://" not in options["viewer"]:
        options |= {"urls": (options["viewer"], *options["urls"]), "viewer": "window"}
    if not options["urls"]:
        raise click.UsageError("name a link, for example udpin:14550")
    if options["record"] and options["rrd"] and options["record"] == options["rrd"]:
        raise click.UsageError("--record and --rrd name the same file")
    if options["dates"] and options["history"] is None:
        raise click.UsageError("--baseline-from needs --history DIR")
    level = "info" if verbose and log_level == "warning" else log_level
    with _told_to_stop(duration) as stop:
        assessment = _follow(options, level, stop, as_json=as_json)
    raise SystemExit(assessment.exit_code)


def _follow(options: dict[str, Any], level: str, stop: Callable[[], bool], *, as_json: bool) -> Assessment:
    """Run a session with what shows it, and print its verdicts."""
    from rich.console import Console

    from mavhums.live.setup import Options, prepare

    console = Console()
    watched = console.is_terminal and not as_json
    _log(level, console if watched else None)
    with ExitStack() as exits:
        viewer, rrd, no_position = (options.pop(name) for name in ("viewer", "rrd", "no_position"))
        wanted = Options(**options)
        drawn = _drawn(viewer, rrd, no_position, exits)
        session = prepare(wanted, drawn, vehicle_states=bool(drawn))
        gc.collect()
        gc.freeze()  # to look at all that start-up made takes the collector a tenth of a second in flight
        exits.callback(gc.unfreeze)
        return _show_until_end(session, options, stop, console, watched=watched, as_json=as_json)


def _drawn(viewer: str | None, rrd: Path | None, no_position: bool, exits: ExitStack) -> list[Drawn]:
    """Open a viewer and a recording, where they are wanted."""
    if viewer is None and rrd is None:
        return []
    from mavhums.live.viewer import Drawn
    from mavhums.show import LiveViewer, Recorder

    position = not no_position
    name = f"live-{time.time_ns():x}"
    if viewer is None and rrd is not None:
        return [Drawn(exits.enter_context(Recorder(rrd, recording_id=name, position=position)))]
    live_viewer = exits.enter_context(
        LiveViewer(viewer or "window", recording_id=name, recording=rrd, position=position)
    )
    if viewer != "window":
        click.echo(f"viewer: {live_viewer.url}", err=True)
    return [Drawn(live_viewer)]


def _show_until_end(
    session: Session,
    options: dict[str, Any],
    stop: Callable[[], bool],
    console: Console,
    *,
    watched: bool,
    as_json: bool,
) -> Assessment:
    from mavhums.live.lines import JsonLines, PlainLines
    from mavhums.show import render

    names = [str(link.address) for link in session.links]
    if as_json:
        lines = JsonLines(click.echo, session.clock.now_us, session.watch)
        lines.start(names, airframe=options["airframe"], signed_only=options["key"] is not None)
        session.sinks.append(lines)
        return session.run(stop)
    if watched:
        from mavhums.live.view import View

        session.sinks.append(View(console, ", ".join(names)))
    else:
        session.sinks.append(PlainLines(click.echo))
        click.echo(f"listening: {', '.join(names)}")
    assessment = session.run(stop)
    render(assessment, console)
    if session.recorder is not None:
        console.print(f"recorded: {session.recorder.path}", highlight=False)
    return assessment


@contextmanager
def _told_to_stop(duration: float | None) -> Iterator[Callable[[], bool]]:
    """Give what tells whether to stop: after a time, at Ctrl-C or SIGTERM; a second one breaks off."""
    told = False
    end = None if duration is None else time.monotonic() + duration

    def tell(number: int, _: FrameType | None) -> None:
        nonlocal told
        told = True
        signal.signal(number, signal.default_int_handler)

    before = {number: signal.signal(number, tell) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: told or (end is not None and time.monotonic() >= end)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _log(level: str, console: Console | None) -> None:
    """Send messages to the standard error; past the table where one is drawn."""
    handler: logging.Handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    if console is not None:
        from rich.logging import RichHandler

        handler = RichHandler(console=console, show_path=False)
    logger = logging.getLogger("mavhums")
    logger.handlers = [handler]
    logger.setLevel(level.upper())
