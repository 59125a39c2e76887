"""The commands ``inspect``, ``check``, ``export``, ``model`` and ``profile``."""

from __future__ import annotations

from pathlib import Path

import click

from mavhums.cli.options import AIRFRAME, DIALECT, JSON, LOG, MODEL, PATH
from mavhums.cli.output import draw, reading, say, say_json
from mavhums.core.errors import ExitCode, MavhumsError

_TO_FILL_IN = "travel_deg, [actuators.ema] and [actuators.limits] of each actuator"


@click.command(short_help="Show what a log allows to judge, and what it lacks.")
@LOG
@AIRFRAME
@DIALECT
@click.option("--messages", is_flag=True, help="List the messages and named values, with their rates.")
@JSON
def inspect(log: Path, airframe: str | None, dialect: Path | None, messages: bool, as_json: bool) -> None:
    """Show what LOG allows to judge, and what it lacks.

    First what can be judged, then each vehicle with its telemetry tier, what is missing and how to record
    it, and the log's losses.

    LOG may be - for the standard input.
    """
    from mavhums.app.inspection import inspect_log

    with reading(log) as progress:
        inspection = inspect_log(log, airframe=airframe, dialect=dialect, progress=progress)
    if as_json:
        say_json(inspection.to_json())
    else:
        from mavhums.show.inspection import inspection_blocks

        draw(inspection_blocks(inspection, messages=messages))
    raise SystemExit(ExitCode.READ_WITH_LOSSES if inspection.assessment.log.losses.any else ExitCode.OK)


@click.command(short_help="Check surfaces that are swept on the ground.")
@LOG
@AIRFRAME
@DIALECT
@JSON
def check(log: Path, airframe: str | None, dialect: Path | None, as_json: bool) -> None:
    """Check the servos whose surfaces are swept on the ground in LOG, before take-off.

    For each: the travel and the speed that it reaches, the hysteresis between the two ways (play, friction
    and lag), the roughness of its motion, and the friction in its current. `analyse --keep` compares
    roughness and friction with the aircraft's earlier sweeps.

    Ends with 0 if travel and speed are reached, and with 10 if not.
    """
    import json
    from dataclasses import asdict

    from mavhums.app.check import check_log

    with reading(log) as progress:
        sweeps = check_log(log, airframe=airframe, dialect=dialect, progress=progress)
    if as_json:
        say_json(json.dumps([asdict(sweep) for sweep in sweeps], indent=2, ensure_ascii=False))
    else:
        for sweep in sweeps:
            say(sweep.as_text())
    raise SystemExit(ExitCode.DEGRADED if any(sweep.faults for sweep in sweeps) else ExitCode.OK)


@click.command(short_help="Write a log as a table: V1–V12, messages, or curves.")
@LOG
@click.option(
    "-o",
    "--output",
    required=True,
    type=PATH,
    metavar="OUT",
    help="Ends in .parquet or .csv. Several messages: a file each, OUT-NAME.",
)
@click.option(
    "--messages",
    metavar="NAME,...",
    help="Write these messages instead of V1–V12; `mavhums inspect` lists them.",
)
@click.option("--curves", is_flag=True, help="Write the curves behind the verdicts, as the report has them.")
@AIRFRAME
@click.option(
    "--classify",
    is_flag=True,
    help="Add what the network says of each sample: p_emergency, class, inside (its training range). What it"
    " says of each ten seconds becomes a file of its own, whose name ends in -windows.",
)
@MODEL
def export(
    log: Path,
    output: Path,
    messages: str | None,
    curves: bool,
    airframe: str | None,
    classify: bool,
    model: str | None,
) -> None:
    """Write V1–V12 of every actuator of LOG, its messages, or the curves behind its verdicts, as a table.

    V1–V12 are one row per sample: vehicle, actuator, time (UTC), flight_time_s, V1 to V12; rows of one
    actuator are in the order of time. Without a profile the second column is output: an ESC may drive a
    propeller. Parquet needs the extra mavhums[arrow].
    """
    from mavhums.app.export import export_curves, export_messages, export_quantities

    if messages is not None and (airframe is not None or classify):
        given = "--classify" if classify else "--airframe"
        raise click.UsageError(f"{given} is for V1–V12; messages are written as they are")
    if model is not None and not classify:
        raise click.UsageError("--model is for --classify")
    if curves and (messages is not None or classify):
        raise click.UsageError("--curves writes curves alone, not --messages nor --classify")
    with reading(log) as progress:
        if curves:
            written = export_curves(log, output, airframe=airframe, progress=progress)
        elif messages is None:
            written = export_quantities(
                log, output, airframe=airframe, classify=classify, model=model, progress=progress
            )
        else:
            names = [name.strip() for name in messages.split(",") if name.strip()]
            written = export_messages(log, output, names, progress=progress)
    for path, rows in written.items():
        say(f"{path}: {rows:,} rows")


@click.group(short_help="Show a model's purpose and its training.")
def model() -> None:
    """Show a model's purpose and its training."""


@model.command("show", short_help="Print the card of a model.")
@click.argument("name", required=False, metavar="[NAME|FILE]")
@JSON
def show_model(name: str | None, as_json: bool) -> None:
    """Print the card of a packaged model, or of the one in FILE.

    The card has the features, the training, the calibration, what the selection found, the metrics,
    and the command that regenerates the model.

    \b
    Packaged, by NAME:
      paper-instrumented    for all of V1-V12 (default)
      paper-without-load    for V1-V10: the load torque is not measured
      paper-esc             for what an ESC reports
    """
    import json

    from mavhums.learn import load_model, models

    network = load_model(name or models()[0])
    if as_json:
        card = {"hash": network.hash, **network.card.model_dump(mode="json")}
        say_json(json.dumps(card, indent=2, ensure_ascii=False))
        return
    from mavhums.show.inspection import card_blocks

    draw(card_blocks(network))
    say(f"Made by: {network.card.command}")  # drawn, a long line wraps; this one is to be copied


@click.group(short_help="Draft an airframe profile, identify its motors.")
def profile() -> None:
    """Draft an airframe profile: which servo moves which surface, and what EMA it is."""


@profile.command("new", short_help="Draft a profile from a log's parameters.")
@LOG
@click.option("-o", "--output", type=PATH, metavar="FILE", help="Default: print it.")
@click.option("--vehicle", type=click.IntRange(1, 255), metavar="N", help="System id, if there are several.")
@click.option("--name", help="Of the airframe. Default: that of the log's file.")
def new_profile(log: Path, output: Path | None, vehicle: int | None, name: str | None) -> None:
    """Draft the profile of the aircraft in LOG from its parameters, to be filled in by you.

    LOG must hold the parameters (PARAM_VALUE): SERVOn_FUNCTION, _MIN, _TRIM, _MAX and _REVERSED of
    ArduPilot; PWM_MAIN_FUNCn, _MINn, _MAXn, _REV (or PWM_AUX, UAVCAN_SV) and CA_SV_CSk_TYPE of PX4.
    """
    from mavhums.actuator.draft import draft_profile
    from mavhums.core.output import written_whole

    if output is not None and output.exists():
        raise MavhumsError(f"{output}: exists already, and you may have filled it in", "name another file")
    with reading(log) as progress:
        text = draft_profile(log, vehicle=vehicle, name=name, progress=progress)
    if output is None:
        say(text.rstrip("\n"))
    else:
        with written_whole(output) as temporary:
            temporary.write_text(text, encoding="utf-8")
        say(f"{output}: drafted {text.count('[[actuators]]')} actuators")
        filled = "nothing: it is the profile that the log names"
        say(f"  fill in: {_TO_FILL_IN if 'FILL IN' in text else filled}")


@profile.command("identify", short_help="Identify each actuator's motor from logs.")
@click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=PATH)
@click.option("--airframe", required=True, metavar="FILE", type=PATH, help="The profile, as drafted.")
@click.option("-o", "--output", type=PATH, metavar="FILE", help="The profile filled in. Default: print it.")
@click.option(
    "--servo-type",
    metavar="NAME",
    help="Write one servo type, [servo_types.NAME], from all these motors in place of the profile.",
)
def identify_motors(
    logs: tuple[Path, ...], airframe: Path, output: Path | None, servo_type: str | None
) -> None:
    """Identify each actuator's motor from LOGs of one aircraft: resistance, back-EMF constant, voltage drop.

    It takes voltage, current and rotor speed at the motor, and no data sheet. The profile gets a section
    [actuators.identified] with each value, its 95 % interval and the logs that it rests on.
    """
    import re

    from mavhums.actuator.profile import load_airframe
    from mavhums.app.identify import identify, servo_type_section, with_motors
    from mavhums.app.settings import Options
    from mavhums.core.output import written_whole

    if output is not None and output.exists():
        raise MavhumsError(f"{output}: exists already", "name another file")
    if servo_type is not None and not re.fullmatch(r"[\w-]+", servo_type, re.ASCII):
        raise click.UsageError("--servo-type NAME: letters, digits, - and _")
    options = Options(airframe=airframe)
    with reading(logs[0]) as progress:
        motors = identify(logs, options, progress=progress)
    if servo_type is None:
        filled = with_motors(airframe.read_text(encoding="utf-8"), motors)
    else:
        filled = servo_type_section(servo_type, motors, load_airframe(airframe))
    if output is None:
        click.echo(filled, nl=False)
        return
    with written_whole(output) as temporary:
        temporary.write_text(filled, encoding="utf-8")
    click.echo(f"{output}: identified {', '.join(motors)}")
