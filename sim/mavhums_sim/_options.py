"""Options that the commands ``flight`` and ``stream`` share: what flies, how it fails, over which link."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

if TYPE_CHECKING:
    from mavhums_sim.conditions import Condition
    from mavhums_sim.flight import Flight
    from mavhums_sim.link import Link

DURATION = click.option(
    "--duration",
    default=100.0,
    type=click.FloatRange(1, 36_000),
    metavar="S",
    help="Seconds.",
)
SEED = click.option(
    "--seed",
    default=0,
    type=click.IntRange(0),
    help="Pilot, gusts and noise; the same seed flies the same.",
)


_FAULT = re.compile(r"(?P<surface>\w+)=(?P<fault>\w+):(?P<numbers>[^@]+)(@(?P<at>[^@]+))?")


def _friction(value: str) -> tuple[str, tuple[float, float]]:
    """Read ``SURFACE=VALUE`` or ``SURFACE=FROM..TO``."""
    surface, _, numbers = value.partition("=")
    start, _, end = numbers.partition("..")
    try:
        return surface, (float(start), float(end or start))
    except ValueError:
        form = "SURFACE=N·m or SURFACE=FROM..TO, for example elevator=0.225..1.0"
        raise click.BadParameter(f"{value!r} is not {form}") from None


def _fault(value: str) -> tuple[str, Condition]:
    """Read ``SURFACE=FAULT:SEVERITY[@S[..S]]`` or ``SURFACE=FAULT:FROM..TO[@S[..S]]``."""
    from mavhums_sim.conditions import Condition

    match = _FAULT.fullmatch(value)
    if not match:
        raise click.BadParameter(f"{value!r} is not SURFACE=FAULT:SEVERITY, for example rudder=jam:10@40")
    start, _, end = match["numbers"].partition("..")
    at_s, _, until_s = (match["at"] or "0").partition("..")
    try:
        return match["surface"], Condition(
            match["fault"], float(start), float(end or start), float(at_s), float(until_s or "inf")
        )
    except ValueError as error:
        raise click.BadParameter(f"{value!r}: {error}") from error


def _output(value: str) -> tuple[str, int]:
    """Read ``SURFACE=N``."""
    surface, _, number = value.partition("=")
    if not (number.isdecimal() and 1 <= int(number) <= 16):
        form = "SURFACE=OUTPUT with output 1…16, for example elevator=2"
        raise click.BadParameter(f"{value!r} is not {form}")
    return surface, int(number)


_OPTIONS = (
    click.option(
        "--friction",
        multiple=True,
        type=_friction,
        metavar="SURFACE=N·m",
        help="Coulomb friction of a surface, 0.9 or growing 0.225..1.0; others have 0.225. Repeatable.",
    ),
    click.option(
        "--fault",
        multiple=True,
        type=_fault,
        metavar="SURFACE=FAULT:X[@S]",
        help="A fault of severity X, or growing X..Y, from S seconds on, or only from S..T. X: friction (N·m"
        " added), backlash (° added), resistance (share gained: 1 doubles it), torque_constant (share lost,"
        " 0…1), supply_sag (V lost, 0…26), sensor_bias (°), jam (N·m that hold the shaft; 10 stop it)."
        " Repeatable.",
    ),
    SEED,
    DURATION,
    click.option(
        "--rate",
        default=100.0,
        type=click.FloatRange(1, 500),
        metavar="HZ",
        help="Actuator telemetry.",
    ),
    click.option(
        "--cyclogram",
        default="takeoff",
        help="preflight, takeoff, cruise, turns, gusts or landing.",
    ),
    click.option(
        "--replay",
        type=click.Path(path_type=Path),
        metavar="LOG.tlog",
        help="Fly the commands of a real log instead of a cyclogram, all of it or --duration.",
    ),
    click.option(
        "--channel",
        multiple=True,
        type=_output,
        metavar="SURFACE=N",
        help="Servo output of the replayed log. Repeatable.",
    ),
    click.option(
        "--hold", is_flag=True, help="Replay: keep each command until the next instead of joining them."
    ),
    click.option(
        "--model",
        type=click.Choice(["single-mass", "two-mass"]),
        default="single-mass",
        help="Rotor and surface as one mass, or as two with the gear's play and stiffness between them.",
    ),
    click.option(
        "--friction-method",
        type=click.Choice(["impulse", "karnopp"]),
        default="impulse",
        help="How dry friction is integrated: as an impulse, or with Karnopp's band of speed that is rest.",
    ),
    click.option(
        "--aircraft", type=click.IntRange(0), metavar="N", help="Fly the individual actuators of aircraft N."
    ),
    click.option(
        "--tier",
        "tiers",
        multiple=True,
        type=click.Choice(["instrumented", "esc-signed", "esc-unsigned", "named", "position", "pwm", "csrv"]),
        default=("instrumented", "esc-unsigned", "pwm"),
        help="How the actuators are reported; csrv is of a .BIN, which has it by default. Repeatable.",
    ),
    click.option(
        "--esc-side",
        type=click.Choice(["motor", "bus"]),
        default="motor",
        help="Where the ESC measures voltage and current.",
    ),
    click.option("--mavlink", type=click.Choice(["1", "2"]), default="2", help="Protocol version."),
    click.option("--key", metavar="HEX", help="Sign with this key of 32 bytes."),
    click.option("--loss", default=0.0, metavar="SHARE", help="Share of the frames lost."),
    click.option("--burst", default=1.0, metavar="N", help="Mean number of frames lost in a row."),
    click.option("--late", default=0.0, metavar="SHARE", help="Share of the frames that others overtake."),
    click.option("--links", default=1, metavar="N", help="Parallel links, 1…4."),
    click.option(
        "--baud",
        type=float,
        metavar="N",
        help="Bits a second of a radio's serial line, as 57600, to which the aircraft thins its streams.",
    ),
    click.option("--clock-offset", default=0.0, metavar="S", help="Error of the vehicle's clock."),
    click.option("--clock-drift", default=0.0, metavar="PPM", help="Growth of that error."),
    click.option(
        "--day",
        type=float,
        metavar="N",
        help="Begin N days after 2026-01-01, for a history. Default: the seed, so that flights differ.",
    ),
    click.option("--reboot", type=float, metavar="S", help="The vehicle restarts at this time."),
)


class Planned(NamedTuple):
    """What the options ask for."""

    flight: Flight
    link: Link


def given(option: str) -> bool:
    """Whether the user gave this option of the running command."""
    source = click.get_current_context().get_parameter_source(option)
    return source is not click.core.ParameterSource.DEFAULT


def with_flight_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options to a command; it receives them as keywords for :func:`plan_flight`."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def plan_flight(options: dict[str, Any]) -> Planned:
    """Return the flight and the link that the options describe.

    Raises
    ------
    click.UsageError
        If they describe none; one line says why.
    OSError
        If a log to be replayed cannot be read.
    """
    try:
        return Planned(_flight(options), _link(options))
    except ValueError as error:
        raise click.UsageError(str(error)) from error


def _flight(options: dict[str, Any]) -> Flight:
    from mavhums_sim.ema import EmaParameters
    from mavhums_sim.flight import Flight

    parameters = EmaParameters.from_data_sheet(friction_method=options["friction_method"])
    conditions: dict[str, tuple[Condition, ...]] = {}
    for surface, condition in options["fault"]:
        conditions[surface] = (*conditions.get(surface, ()), condition)
    cyclogram, duration = options["cyclogram"], options["duration"]
    if options["replay"]:
        from mavhums_sim.replay import replay

        played = replay(options["replay"], dict(options["channel"]), "hold" if options["hold"] else "linear")
        cyclogram = played.cyclogram
        if not given("duration"):
            duration = float(cyclogram.time_s[-1])
        click.echo(
            f"replaying {', '.join(f'{s} from output {n}' for s, n in played.channels.items())},"
            f" {played.rate_hz:.1f} commands a second, {duration:.0f} s",
            err=True,
        )
    return Flight(
        seed=options["seed"],
        duration_s=duration,
        friction_nm=dict(options["friction"]),
        rate_hz=options["rate"],
        parameters=parameters.two_masses() if options["model"] == "two-mass" else parameters,
        cyclogram=cyclogram,
        conditions=conditions,
        individuals=options["aircraft"],
        esc_side=options["esc_side"],
        tiers=options["tiers"],
    )


def _link(options: dict[str, Any]) -> Link:
    from mavhums_sim.link import LAST_DAY, Link

    return Link(
        loss=options["loss"],
        burst=options["burst"],
        late=options["late"],
        links=options["links"],
        baud=options["baud"],
        clock_offset_s=options["clock_offset"],
        clock_drift_ppm=options["clock_drift"],
        reboot_at_s=options["reboot"],
        day=float(options["seed"] % LAST_DAY) if options["day"] is None else options["day"],
        mavlink=1 if options["mavlink"] == "1" else 2,
        key=bytes.fromhex(options["key"]) if options["key"] else None,
    )
