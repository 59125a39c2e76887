"""A flight judged alone and then held against a baseline is the flight judged beside it from the start."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mavhums import Engine
from mavhums.actuator.mapping import AirframeNamed
from mavhums.actuator.profile import load_airframe
from mavhums.app.analysis import analyse_alone
from mavhums.app.settings import Options
from mavhums.core.errors import MavhumsError
from mavhums.engine.events import Event, StandaloneAssessment
from mavhums.engine.options import EngineOptions
from mavhums.flights.compare import ActuatorComparison, FlightComparison, compared, packed, unpacked
from mavhums.health.decision.baseline import Baseline, Baselines
from mavhums.health.decision.events import (
    ComparisonInput,
    ConditionChanged,
    Estimate,
    FaultRecord,
    Forgotten,
    IndicatorStep,
    Window,
)
from mavhums.health.decision.limits import Levels
from mavhums.results.assessment import Assessment
from mavhums.results.sections import DECIDE, Decide
from mavhums_sim import Flight, Gearbox, fly, write_tlog
from mavhums_sim.conditions import Condition
from mavhums_sim.ema import EmaParameters
from tests.fleet_logs import joined, records
from tests.strategies import cuts

TWO_MASSES = EmaParameters.from_data_sheet(gearbox=Gearbox())
KINDS = ("healthy", "wear", "jam", "backlash", "silent", "several", "short")


def in_flight(path: Path, options: EngineOptions, baselines: Baselines) -> Assessment:
    """Judge as a link is judged: the drift test fed while it flies."""
    engine = FlightComparison(Engine(options), lambda *_: baselines)
    engine.feed(path.read_bytes())
    engine.finish()
    return engine.assessment(str(path), None)


def judged_later(path: Path, options: EngineOptions, baselines: Baselines) -> Assessment:
    assessment = compared(unpacked(packed(analyse_alone(path, options))), lambda *_: baselines)
    return assessment.model_copy(update={"log": assessment.log.model_copy(update={"sha256": None})})


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("replay")

    def log(name: str, seed: int, *, seconds: float = 30.0, **given: object) -> Path:
        path = folder / f"{name}.tlog"
        flight = Flight(seed, seconds, rate_hz=25.0, tiers=("instrumented",), **given)  # type: ignore[arg-type]
        write_tlog(fly(flight), path)
        return path

    made = {
        "healthy": log("healthy", 1, seconds=60.0),
        "wear": log("wear", 2, friction_nm={"elevator": (0.2, 1.2), "rudder": (0.3, 0.5)}),
        "jam": log("jam", 3, conditions={"elevator": (Condition.step("jam", 5.0, 12.0),)}),
        "backlash": log(
            "backlash",
            4,
            parameters=TWO_MASSES,
            conditions={"elevator": (Condition.step("backlash", 3.0, 10.0),)},
        ),
        "short": log("short", 5, seconds=11.0),
    }
    silent, several = folder / "silent.tlog", folder / "several.tlog"
    frames = [*records(made["healthy"].read_bytes())]
    debug, start = 350, frames[0][0]
    silent.write_bytes(
        b"".join(
            time.to_bytes(8, "big") + frame
            for time, frame in frames
            if int.from_bytes(frame[7:10], "little") != debug or time < start + 25_000_000
        )
    )
    several.write_bytes(joined(made["wear"].read_bytes(), made["backlash"].read_bytes()))
    return made | {"silent": silent, "several": several}


@pytest.fixture(scope="module")
def alone(logs: dict[str, Path]) -> dict[str, StandaloneAssessment]:
    return {kind: analyse_alone(logs[kind], Options().resolved()) for kind in KINDS}


def baselines_about(flight: StandaloneAssessment, shifts: list[float], spread: float) -> Baselines:
    """Return baselines that lie beside what the flight shows, each by another share of it."""
    found = [(v.vehicle or 0, v.actuator, one) for v in flight.assessment.verdicts for one in v.indicators]
    return {
        (vehicle, actuator, one.fault): Baseline(
            one.value.estimate - shift * max(abs(one.value.estimate), 0.01), spread, 12, spread, 2 * spread
        )
        for (vehicle, actuator, one), shift in zip(found, shifts * len(found), strict=False)
    }


@pytest.mark.slow
@given(
    kind=st.sampled_from(KINDS),
    shifts=st.lists(st.sampled_from([-0.2, 0.0, 0.01, 0.03, 0.1, 0.5, 3.0]), min_size=1, max_size=7),
    spread=st.sampled_from([1e-5, 1e-4, 1e-3, 1e-2]),
    false_alarms=st.sampled_from([0.01, 1.0, 100.0]),
    decide=st.sampled_from(DECIDE),
)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_replayed_verdicts_are_those_of_the_drift_followed_in_flight(
    logs: dict[str, Path],
    alone: dict[str, StandaloneAssessment],
    kind: str,
    shifts: list[float],
    spread: float,
    false_alarms: float,
    decide: Decide,
) -> None:
    options = replace(Options().resolved(), false_alarms=false_alarms, decide=decide)
    baselines = baselines_about(alone[kind], shifts, spread)
    assert judged_later(logs[kind], options, baselines) == in_flight(logs[kind], options, baselines)


@pytest.mark.slow
@pytest.mark.parametrize("decide", DECIDE[:2])
@pytest.mark.parametrize("kind", KINDS)
def test_the_cases_do_drift_but_what_the_network_decided_no_friction_overrules(
    logs: dict[str, Path], alone: dict[str, StandaloneAssessment], kind: str, decide: Decide
) -> None:
    baselines = baselines_about(alone[kind], [0.5], 1e-4)
    if decide == "network":
        baselines = {key: own for key, own in baselines.items() if key[2] == "friction"}
    options = replace(Options().resolved(), decide=decide)
    later = judged_later(logs[kind], options, baselines)
    assert later == in_flight(logs[kind], options, baselines)
    drifts = "friction_drift" in {one.kind for verdict in later.verdicts for one in verdict.evidence}
    assert drifts == (decide == "physics") or kind == "short"


@pytest.mark.slow
@given(kind=st.sampled_from(KINDS), data=st.data())
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_where_blocks_end_changes_no_event_of_the_comparison(
    logs: dict[str, Path], alone: dict[str, StandaloneAssessment], kind: str, data: st.DataObject
) -> None:
    content, baselines = logs[kind].read_bytes(), baselines_about(alone[kind], [0.5], 1e-4)

    def events(places: list[int]) -> dict[tuple[int, str], list[Event]]:
        engine = FlightComparison(Engine(), lambda *_: baselines)
        told = [e for a, b in pairwise([0, *places, len(content)]) for e in engine.feed(content[a:b])]
        found: dict[tuple[int, str], list[Event]] = {}
        for event in [*told, *engine.finish()]:
            if isinstance(event, Window | ConditionChanged):
                found.setdefault((event.vehicle, event.actuator), []).append(event)
        return found

    assert events(data.draw(cuts(len(content)))) == events([])


def test_what_another_profile_judged_is_no_evidence(logs: dict[str, Path]) -> None:
    indicator = FaultRecord("friction", "friction", "N·m", Levels(0.375, 0.875), two_sided=False)
    step = IndicatorStep(indicator, Estimate(0.24, 0.03, 9.0), None)
    ends = [(10.0 * k, 10.0 * k + 10.0) for k in range(40)]

    def until_drift(named_after: int | None) -> int:
        """Return how many windows it takes until the friction has drifted."""
        own = {(1, "rudder", "friction"): Baseline(0.2, 0.001, 12, 0.001, 0.002)}
        comparison = FlightComparison(Engine(), lambda *_: own)
        comparison.feed(logs["short"].read_bytes())
        for k, end in enumerate(ends):
            named = [AirframeNamed(end[0], 1, load_airframe("paper"))] if k == named_after else []
            window = Window(1, "rudder", *end, 1.0, None, "undecided")
            told = comparison.follow([*named, ComparisonInput(1, "rudder", *end, (step,)), window])
            if any(isinstance(event, ConditionChanged) for event in told):
                return k + 1
        return len(ends)

    alone = until_drift(None)
    assert 1 < alone < len(ends) / 2
    assert until_drift(alone - 1) >= 2 * alone - 1


def test_an_actuator_that_is_forgotten_takes_its_drift_back() -> None:
    """What the limits left undecided the baseline degraded: the change that revises it says so."""
    indicator = FaultRecord("friction", "friction", "N·m", Levels(0.375, 0.875), two_sided=False)
    comparison = ActuatorComparison({"friction": Baseline(0.2, 0.001, 12, 0.001, 0.002)})
    told: list[Event] = []
    for k in range(8):
        steps = (IndicatorStep(indicator, Estimate(0.3, 0.01, 9.0), None),)
        told += comparison.follow(ComparisonInput(1, "rudder", 10.0 * k, 10.0 * k + 10.0, steps))
        told += comparison.follow(Window(1, "rudder", 10.0 * k, 10.0 * k + 10.0, 1.0, None, "undecided"))
    told += comparison.follow(Forgotten(1, "rudder", 85.0, "undecided: it moves something else"))
    drifted, revised = (event for event in told if isinstance(event, ConditionChanged))
    assert (drifted.before, drifted.after, drifted.since_s) == ("undecided", "degraded", 0.0)
    assert (revised.before, revised.after, revised.time_s) == ("degraded", "undecided", 85.0)
    assert [event.condition for event in told if isinstance(event, Window)][-1] == "degraded"


def test_without_baselines_the_flight_alone_is_returned(alone: dict[str, StandaloneAssessment]) -> None:
    assert compared(alone["wear"], lambda airframe, start: {}) == alone["wear"].assessment


def test_a_flight_comes_back_from_its_bytes_and_other_bytes_are_refused(
    alone: dict[str, StandaloneAssessment],
) -> None:
    for flight in alone.values():
        assert unpacked(packed(flight)) == flight
    for data in (b"", b"no flight", packed(alone["short"])[:-9]):
        with pytest.raises(MavhumsError, match="stored flight"):
            unpacked(data)
