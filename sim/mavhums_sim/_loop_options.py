"""Options of ``flight --closed-loop``: air, mission, messages, and what fails."""

from __future__ import annotations

import re
from collections.abc import Callable
from math import inf, nan
from typing import TYPE_CHECKING, Any

import click

from mavhums_sim._options import Planned, given

if TYPE_CHECKING:
    from mavhums_sim.closed_loop import Air, ClosedLoop, Confounder, SurfaceFault
    from mavhums_sim.closed_loop.reports import Streams

_NUMBER = r"\d+(?:\.\d+)?"
_TIMES = rf"(@(?P<at>{_NUMBER})(\.\.(?P<until>{_NUMBER}))?)?"


_FAULT = re.compile(rf"(?P<surface>\w+)=(?P<kind>\w+)(:(?P<value>-?{_NUMBER}))?{_TIMES}")
_CONFOUNDER = re.compile(rf"(?P<kind>\w+):(?P<value>-?{_NUMBER}){_TIMES}")


def _surface_fault(value: str) -> SurfaceFault:
    """Read ``SURFACE=KIND[:X][@S[..S]]``."""
    from mavhums_sim.closed_loop import SurfaceFault

    match = _FAULT.fullmatch(value)
    if not match:
        form = "SURFACE=KIND[:X][@S[..S]], for example rudder=freeze:10@60"
        raise click.BadParameter(f"{value!r} is not {form}")
    try:
        return SurfaceFault(match["surface"], match["kind"], float(match["value"] or nan), *_times(match))
    except ValueError as error:
        raise click.BadParameter(f"{value!r}: {error}") from error


def _confounder(value: str) -> Confounder:
    """Read ``KIND:X@S[..S]``."""
    from mavhums_sim.closed_loop import Confounder

    match = _CONFOUNDER.fullmatch(value)
    if not match:
        raise click.BadParameter(f"{value!r} is not KIND:X@S[..S], for example engine:0@60")
    try:
        return Confounder(match["kind"], float(match["value"]), *_times(match))
    except ValueError as error:
        raise click.BadParameter(f"{value!r}: {error}") from error


def _wind(value: str) -> tuple[float, float]:
    """Read ``M/S`` or ``M/S@DEGREES``."""
    speed, _, direction = value.partition("@")
    try:
        return float(speed), float(direction or 0.0)
    except ValueError:
        raise click.BadParameter(f"{value!r} is not M/S or M/S@DEGREES, for example 5@270") from None


_OPTIONS = (
    click.option(
        "--closed-loop", is_flag=True, help="Fly an aircraft that answers to its surfaces (JSBSim)."
    ),
    click.option(
        "--surface-fault",
        multiple=True,
        type=_surface_fault,
        metavar="SURFACE=KIND[:X][@S[..S]]",
        help="Closed loop: freeze (:X°, else in place), float, gain:SHARE, slow:S, slow_rate:°/s, bias:° or"
        " backlash:°, from S to S seconds. Repeatable.",
    ),
    click.option(
        "--confounder",
        multiple=True,
        type=_confounder,
        metavar="KIND:X@S[..S]",
        help="Closed loop: engine:SHARE LEFT, airspeed:SHARE READ, wind:M/S GAINED or"
        " gps:M/S DRIFT. Repeatable.",
    ),
    click.option(
        "--wind", type=_wind, default="0", metavar="M/S[@DEG]", help="Closed loop: speed, and where from."
    ),
    click.option(
        "--turbulence",
        default=0.0,
        metavar="M/S",
        help="Closed loop: wind at 20 ft; 7.7 is light, 15.4 moderate.",
    ),
    click.option("--layout", default="conventional", help="Closed loop: conventional, elevon or vtail."),
    click.option("--autopilot", default="ardupilot", help="Closed loop: messages of ardupilot or px4."),
    click.option(
        "--mission", default="mixed", help="Closed loop: mixed, waypoints, loiter, heading or manual."
    ),
    click.option("--stream-rate", default=10.0, metavar="HZ", help="Closed loop: of the vehicle's messages."),
    click.option(
        "--ema", is_flag=True, help="Closed loop: EMAs move the surfaces; implied by --fault and --friction."
    ),
)
_NAMES = (
    *("surface_fault", "confounder", "wind", "turbulence", "layout", "autopilot", "mission"),
    *("stream_rate", "ema"),
)


def with_loop_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options to a command; it receives them as keywords for :func:`plan_loop`."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def plan_loop(planned: Planned, options: dict[str, Any]) -> tuple[ClosedLoop, Streams] | None:
    """Return the closed-loop flight and its message rates; None where none is asked for.

    Raises
    ------
    click.UsageError
        If the options describe none, or are given without ``--closed-loop``.
    """
    if not options["closed_loop"]:
        stray = next((name for name in _NAMES if given(name)), None)
        if stray:
            raise click.UsageError(f"--{stray.replace('_', '-')} needs --closed-loop")
        return None
    stray = next((name for name in ("cyclogram", "replay") if given(name)), None)
    if stray:
        raise click.UsageError(
            f"--{stray} and --closed-loop exclude each other: --mission says what is flown"
        )
    from mavhums_sim.closed_loop import ClosedLoop
    from mavhums_sim.closed_loop.reports import Streams

    with_emas = options["ema"] or given("fault") or given("friction")
    try:
        flight = ClosedLoop(
            seed=options["seed"],
            airframe=options["aircraft"],
            duration_s=options["duration"],
            layout=options["layout"],
            flavour=options["autopilot"],
            mission=options["mission"],
            air=_air(options),
            faults=options["surface_fault"],
            confounders=options["confounder"],
            emas=planned.flight if with_emas else None,
        )
        return flight, Streams(rate=options["stream_rate"], status=min(2.0, options["stream_rate"]))
    except ValueError as error:
        raise click.UsageError(str(error)) from error


def _air(options: dict[str, Any]) -> Air:
    from mavhums_sim.closed_loop import Air

    speed, direction = options["wind"]
    return Air(speed, direction, options["turbulence"])


def _times(match: re.Match[str]) -> tuple[float, float]:
    return float(match["at"] or 0.0), float(match["until"] or inf)
