"""Every figure of whole results, held against those of the last change that was meant to move them.

The other tests say what must be so; this one says that a number, a date or a reason has moved at all.
``RENEW_FIGURES=1 pytest tests/test_figures.py`` writes the files in ``tests/data/figures`` anew; their
difference is what the change does.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
import re
import zlib
from collections.abc import Callable, Iterable, Iterator
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from mavhums.app.settings import Options
from mavhums.core.conditions import Condition
from mavhums.engine.engine import Engine
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.compare import compared, packed
from mavhums.flights.history import PastFlight
from mavhums.flights.trends import trend_report
from mavhums.health.axis.effectiveness import EffectivenessTracker
from mavhums.health.axis.monitor import AxisMonitor
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.decision.growth import course_of, last_step
from mavhums.health.estimation.equations.own_scale import RIPPLE, ROUGHNESS, TWO_WAYS
from mavhums.health.estimation.motor_identification import VoltageSums
from mavhums.health.estimation.random_effects import scattering_share, variance_between
from mavhums.health.motor.monitor import MotorMonitor
from mavhums.health.self_baseline.comparison import compare
from mavhums.health.self_baseline.motor import motor_indicators
from mavhums.log import read_blocks
from mavhums.results.verdict import Interval
from mavhums.vehicle.rows import Rows
from mavhums_sim import Flight, fly, write_tlog
from mavhums_sim.conditions import Condition as Fault
from mavhums_sim.rover import Rover, SteeringFault, drive
from mavhums_sim.rover import write_tlog as write_drive
from tests.app.test_replay import TWO_MASSES, baselines_about
from tests.conftest import CARRIED, carried_logs
from tests.engine.test_forward_flight import TILTROTOR, transition
from tests.engine.wired import PX4_PLANE, Wired
from tests.flights import START, flown, identity, shown, verdict
from tests.health.axis import test_origin
from tests.health.axis.flights import rolling, rows, turning
from tests.health.axis.test_detectors import controlled
from tests.health.decision import test_growth
from tests.health.motor import test_monitor, test_past
from tests.health.self_baseline import test_own_judge, test_strokes
from tests.health.self_baseline.servo import EQUATION, Servo, blank, collected, left
from tests.health.self_baseline.servo import past as past_of

FIGURES = CARRIED / "figures"
ALIKE = 1e-3  # of a number: processors differ in the last digits, and some figures are differences
VOLATILE = {"path", "sha256", "hash", "version"}


def _written(flight: Callable[[], bytes], ending: str, folder: Path) -> Path:
    log = folder / f"log{ending}"
    log.write_bytes(flight())
    os.utime(log, (1_700_000_000, 1_700_000_000))  # it dates a log that has no clock
    return log


def _rotors(frame: str, loss: float, folder: Path) -> Path:
    return test_monitor.log(folder / "log.tlog", frame, loss, seed=4)


def _steered(boat: bool, fault: SteeringFault | None, folder: Path) -> Path:
    drove = drive(Rover(boat=boat, rough=0.01), 150.0, 4, fault)
    write_drive(drove, folder / "log.tlog")
    return folder / "log.tlog"


def _servos(tier: str, condition: Fault, folder: Path) -> Path:
    worn = {"elevator": (condition,)}
    flight = Flight(7, 40.0, rate_hz=25.0, tiers=(tier,), parameters=TWO_MASSES, conditions=worn)
    write_tlog(fly(flight), folder / "log.tlog")
    return folder / "log.tlog"


def _carried(path: Path, _: Path) -> Path:
    return path


LOGS: dict[str, Callable[[Path], Path]] = {
    **{path.stem: partial(_carried, path) for path in carried_logs()},
    "dataflash": partial(_written, Wired(left=0.7).dataflash, ".BIN"),
    "ulog": partial(_written, Wired(parameters=PX4_PLANE, left=0.4).ulog, ".ulg"),
    "tiltrotor": partial(_written, Wired(parameters=TILTROTOR, others=transition()).tlog, ".tlog"),
    "inferred": partial(_written, Wired(parameters={}, coordinated_s=90.0).tlog, ".tlog"),
    **{
        craft: partial(_steered, craft == "boat", fault)
        for craft, fault in (("rover", SteeringFault(90.0, 0.4)), ("boat", None))
    },
    **{
        frame.replace(" ", "-"): partial(_rotors, frame, loss)
        for frame, loss in (("quad x", 0.5), ("hexa +", 0.4), ("octa x", 0.0))
    },
    **{
        fault: partial(_servos, tier, Fault.step(fault, size, 12.0))
        for tier, fault, size in (
            ("instrumented", "jam", 5.0),
            ("instrumented", "backlash", 3.0),
            ("instrumented", "resistance", 0.5),
            ("instrumented", "torque_constant", 0.3),
            ("esc-unsigned", "supply_sag", 20.0),
        )
    },
}


@pytest.mark.parametrize("name", LOGS)
def test_of_a_log(name: str, tmp_path: Path) -> None:
    options = dataclasses.replace(Options().resolved(), vehicle_states=True)
    engine = Engine(options)
    path = LOGS[name](tmp_path)
    events = [event for block in read_blocks(path) for event in engine.feed(block)]
    events += engine.finish()
    flight = StandaloneAssessment(engine.assessment(str(path)), engine.profiles(), options.false_alarms)
    beside = compared(flight, lambda *_: baselines_about(flight, [0.0, 0.05, 0.5], 1e-3))
    found = {"alone": json.loads(zlib.decompress(packed(flight))), "compared": dumped(beside.verdicts)}
    hold(name, found | {"events": condensed(events)})


_OWN = ("vehicle", "actuator", "fault", "kind")


def condensed(events: Iterable[Any]) -> dict[str, Any]:
    """Return for each number of all events of a kind: how often, mean, scatter, least and most; else what."""
    columns: dict[str, list[Any]] = {}
    for event in events:
        whose = [getattr(event, name, "") for name in _OWN[1:]]
        fields = dataclasses.fields(event) if dataclasses.is_dataclass(event) else ()
        for field in (field for field in fields if field.name not in (*_OWN, "reference_s")):
            value = getattr(event, field.name)
            key = " ".join([type(event).__name__, *map(str, filter(None, whose)), field.name])
            columns.setdefault(key, []).append(value)
    return {key: summary for key, values in columns.items() if (summary := _summary(values)) is not None}


def _summary(values: list[Any]) -> Any:
    known = [value for value in values if value is not None]
    if not known:
        return len(values)
    if isinstance(known[0], Interval):
        return [_summary(list(ends)) for ends in zip(*([n for _, n in one] for one in known), strict=True)]
    if isinstance(known[0], str):
        return [[text, len(list(run))] for text, run in itertools.groupby(known)]
    if isinstance(known[0], (int, float, np.ndarray)):
        arrays = [np.asarray(value, dtype=np.float64) for value in known]
        columns = [one.reshape(len(one), -1) if one.ndim > 1 else one.reshape(-1, 1) for one in arrays]
        column = np.concatenate(columns)
        known = [column[np.isfinite(column[:, k]), k] for k in range(column.shape[1])]
        return [[len(one), one.mean(), one.std(), one.min(), one.max()] for one in known if len(one)]
    return None


def upset(column: str, shift: float, side_force: float = 0.0) -> Rows:
    """Return a flight whose roll or rate leaves the controlled one at 100 s."""
    flight = controlled(160)
    flight[column][100 * 20 :] += shift
    flight["side_force"][102 * 20 :] = side_force
    return rows(flight)


def faded(delay: int, kept: float) -> Rows:
    """Return a flight whose ailerons lose effect or time at 100 s."""
    before = rolling(200, partial(np.full_like, fill_value=2.2))
    after = rolling(200, partial(np.full_like, fill_value=2.2 * kept), delay=delay)
    before.roll_rate[100 * 20 :] = after.roll_rate[100 * 20 :]
    return before


AXES: dict[str, Callable[[], Rows]] = {
    "left elevon": partial(test_origin.mixed, "left", 0.0),
    "right elevon": partial(test_origin.mixed, "right", 0.2),
    "both elevons": partial(test_origin.mixed, "both", 0.5),
    "tracking": partial(upset, "roll", 0.9),
    "hard over": partial(upset, "roll_rate", 0.6, 1.6),
    "turns": partial(turning, 160, spiral=0.4),
    "slow": partial(faded, 13, 1.0),
    "weak": partial(faded, 4, 0.55),
    "gone": partial(faded, 4, 0.1),
}


@pytest.mark.parametrize("name", AXES)
def test_of_an_axis(name: str) -> None:
    flight, coupled = AXES[name](), "pitch" if "elevon" in name else None
    seconds = EffectivenessTracker("roll", coupled=coupled).feed(flight)
    monitor = AxisMonitor(1, mixed={"roll": coupled, coupled: "roll"} if coupled else None)
    events = list(monitor.feed(flight))
    found = {axis: dumped(monitor.findings(axis)) for axis in ("roll", "pitch", "yaw")}
    figures = {"seconds": condensed(seconds), "events": condensed(events), "origins": monitor.origins()}
    hold(f"axis {name}", figures | {"found": found})


def test_of_growth_and_scatter() -> None:
    found: dict[str, Any] = {}
    parts = ("grows", "evidence", "since", "per_flight", "left_out")
    for seed in range(4):
        for slope, begin in ((0.0, 0), (0.004, 0), (0.006, 12)):
            numbers, values, errors = test_growth.history(seed, 30, slope, begin=begin)
            errors *= 1.0 + 0.5 * np.cos(numbers)
            values[7] += 0.2 * (seed == 1)
            values[18:] -= 0.08 * (seed == 2)
            step = last_step(values, errors)
            one = course_of(numbers, values, errors, begin=step or 0)
            design = np.column_stack([np.ones_like(numbers), numbers])
            found[f"{seed} {slope}"] = {
                "step": step,
                "course": one and {part: dumped(getattr(one, part)) for part in parts},
                "left": one and [round(flights, 3) for flights in one.flights_left(0.5)],
                "between": variance_between(design, values, errors),
                "share": dumped(scattering_share(design, values, errors)),
            }
    hold("growth", found)


def test_of_motors_beside_earlier_flights() -> None:
    weak = test_past.flight(test_past.FLAT, lost=1, share=0.3)
    hold("motors", dumped(test_past.compared(weak, test_past.earlier(5))))


MOTORS = {
    "weak": ("quad x", 0.2, 25.0),
    "stopped": ("quad +", 1.0, 25.0),
    "seldom": ("quad x", 0.7, 4.0),
    "whole": ("hexa x", 0.0, 50.0),
    "of eight": ("octa x", 1.0, 10.0),
}


@pytest.mark.parametrize("name", MOTORS)
def test_of_motors(name: str) -> None:
    frame, loss, hz = MOTORS[name]
    monitor = MotorMonitor(1, test_monitor.rotors(frame))
    flight = test_monitor.settled(test_monitor.fly_with(loss, frame, 6), hz, 6)
    events = test_monitor.judged(monitor, flight)
    found, state = monitor.findings(), monitor._state
    parts = ("loss", "several", "flown_s", "judged_s", "tipped", "bound", "indicators")
    shown = {part: dumped(getattr(found, part)) for part in parts}
    sums = {part: getattr(state, part).tolist() for part in ("noise", "weight", "bound", "recent", "values")}
    hold(f"motors {name}", {"found": shown, "state": dumped(sums), "events": condensed(events)})


def own() -> Iterator[tuple[str, Any]]:
    """Yield comparisons of a servo with its own flights."""
    current = test_own_judge
    worn = past_of(*(current.flight(80 + k, 0.08) for k in range(3)))
    for name, seed, friction_a in (("like", 51, 0.05), ("risen", 84, 0.08), ("fallen", 53, 0.03)):
        for past in (current.HEALTHY[:5], current.HEALTHY, [*current.HEALTHY, *worn]):
            yield f"{name} {len(past)}", compare(EQUATION, current.flight(seed, friction_a), past)
    swept = [test_strokes.left(test_strokes.swept(seed), TWO_WAYS) for seed in range(12)]
    past = [PastRecord((record,), "2026-03-01", True) for record in swept[:-1] if record]
    yield "strokes", swept[-1] and compare(TWO_WAYS, swept[-1], past)
    loaded = [left(Servo(load_friction=0.2), seed) for seed in range(30, 42)]
    yield "by load", compare(EQUATION, loaded[-1], past_of(*loaded[:-1]))


def test_of_a_servos_own_flights() -> None:
    hold("own", {name: dumped(found) for name, found in own()})


def test_of_what_a_flight_leaves_of_a_servo() -> None:
    """Sums of a flight, from which all later comparisons are made: each column's own."""
    found: list[Any] = [test_own_judge.HEALTHY[0].records[0]]
    found += [test_strokes.left(test_strokes.swept(3), one) for one in (TWO_WAYS, ROUGHNESS, RIPPLE)]
    found += [collected(VoltageSums(blank()), Servo().flown(5)), left(Servo(load_friction=0.2), 30)]
    dumps = []
    for record in found:
        groups = np.array(record.groups)
        dumps.append(dumped(record.model_copy(update={"groups": ()})) | {"sums": groups.sum(axis=0).tolist()})
    hold("records", dumps)


def test_of_a_servos_motor() -> None:
    def voltage(seed: int, servo: Servo) -> Any:
        return collected(VoltageSums(blank()), servo.flown(seed))

    past = [PastRecord((voltage(seed, Servo()),), "2026-03-01", True) for seed in range(11)]
    found = [motor_indicators([voltage(30, servo)], past) for servo in (Servo(), Servo(resistance=23.0))]
    hold("motor", dumped(found))


@pytest.mark.parametrize("course", ["growing", "step", "worn", "mended"])
def test_of_a_trend(course: str) -> None:
    rng, days = np.random.default_rng(5), np.arange(30.0)
    means = {
        "growing": 0.2 + 0.004 * days,
        "step": 0.2 + 0.03 * (days > 17),
        "worn": 0.3 + 0.012 * days,
        "mended": 0.4 - 0.19 * (days > 20),
    }[course]
    flights = []
    for day, mean in zip(days.tolist(), means.tolist(), strict=True):
        value = mean + 0.006 * float(rng.standard_normal())
        condition: Condition = "normal" if value < 0.375 else "degraded"
        both = shown(value), shown(20.0 + 10 * value, fault="winding_resistance", error=0.05)
        whose = [identity(day=day)]
        flights.append(PastFlight.of(flown(verdict(*both, condition=condition), day=day, identities=whose)))
    repaired: dict[str | None, datetime] = {}
    if course == "mended":
        repaired["elevator"] = START + timedelta(days=20.5)
    report = trend_report(flights, repaired=repaired)
    hold(course, dumped(report))


def dumped(result: Any) -> Any:
    return TypeAdapter(Any).dump_python(result, mode="json", fallback=np.ndarray.tolist)


def hold(name: str, found: Any) -> None:
    path = FIGURES / f"{name}.json"
    if os.environ.get("RENEW_FIGURES"):
        FIGURES.mkdir(exist_ok=True)
        text = json.dumps(_rounded(found), indent=1) + "\n"
        text = re.sub(r"\[\s+([^][{}]*?)\s+\]", lambda row: f"[{re.sub(chr(10) + ' +', ' ', row[1])}]", text)
        # Where the log lay when the figures were taken is no figure.
        path.write_text(re.sub(r'("path": ")[^"]*/', r"\1", text), encoding="utf-8")
    moved = list(differences(json.loads(path.read_text(encoding="utf-8")), found, name))
    assert not moved, f"{len(moved)} figures moved, among them {moved[:5]}"


def _rounded(found: Any) -> Any:
    if isinstance(found, dict):
        return {key: _rounded(value) for key, value in found.items()}
    if isinstance(found, list):
        return [_rounded(value) for value in found]
    return float(f"{found:.6g}") if isinstance(found, float) else found


def differences(known: Any, found: Any, place: str) -> Iterator[str]:
    """Yield the places where what was known has changed; what is new is no change."""
    if isinstance(known, dict) and isinstance(found, dict):
        for key in known.keys() - VOLATILE:
            yield from differences(known[key], found.get(key, "nothing"), f"{place}.{key}")
    elif isinstance(known, list) and isinstance(found, list) and len(known) == len(found):
        for k, pair in enumerate(zip(known, found, strict=True)):
            yield from differences(*pair, f"{place}[{k}]")
    elif isinstance(known, float) and isinstance(found, (int, float)):
        if found != pytest.approx(known, rel=ALIKE, abs=1e-9):
            yield f"{place}: {known} is {found}"
    elif known != found:
        yield f"{place}: {known!r:.60} is {found!r:.60}"
