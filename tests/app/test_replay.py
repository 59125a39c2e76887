"""A flight judged alone is compared with a baseline, from what a store keeps of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from mavhums.app.analysis import analyse_alone
from mavhums.app.settings import Options
from mavhums.core.errors import MavhumsError
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.compare import compared, packed, unpacked
from mavhums.health.decision.baseline import Baseline, Baselines
from mavhums.results.sections import DECIDE, Decide
from mavhums_sim import Flight, Gearbox, fly, write_tlog
from mavhums_sim.conditions import Condition
from mavhums_sim.ema import EmaParameters
from tests.fleet_logs import joined, records

TWO_MASSES = EmaParameters.from_data_sheet(gearbox=Gearbox())
KINDS = ("healthy", "wear", "jam", "backlash", "silent", "several", "short")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("replay")

    jam, backlash = (
        {"elevator": (Condition.step(*fault),)} for fault in (("jam", 5.0, 12.0), ("backlash", 3.0, 10.0))
    )
    flights = {
        "healthy": Flight(1, 60.0),
        "wear": Flight(2, 30.0, {"elevator": (0.2, 1.2), "rudder": (0.3, 0.5)}),
        "jam": Flight(3, 30.0, conditions=jam),
        "backlash": Flight(4, 30.0, conditions=backlash, parameters=TWO_MASSES),
        "short": Flight(5, 11.0),
    }
    made = {kind: folder / f"{kind}.tlog" for kind in KINDS}
    for kind, flight in flights.items():
        write_tlog(fly(replace(flight, rate_hz=25.0, tiers=("instrumented",))), made[kind])
    frames = [*records(made["healthy"].read_bytes())]
    debug, end = 350, frames[0][0] + 25_000_000
    heard = [one for one in frames if int.from_bytes(one[1][7:10], "little") != debug or one[0] < end]
    made["silent"].write_bytes(b"".join(time.to_bytes(8, "big") + frame for time, frame in heard))
    made["several"].write_bytes(joined(made["wear"].read_bytes(), made["backlash"].read_bytes()))
    return made


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
@pytest.mark.parametrize("decide", DECIDE[:2])
@pytest.mark.parametrize("kind", KINDS)
def test_the_cases_do_drift_but_what_the_network_decided_no_friction_overrules(
    logs: dict[str, Path], kind: str, decide: Decide
) -> None:
    alone = analyse_alone(logs[kind], replace(Options().resolved(), decide=decide))
    baselines = baselines_about(alone, [0.5], 1e-4)
    later = compared(unpacked(packed(alone)), lambda *_: baselines)
    assert later == compared(alone, lambda *_: baselines)
    drifts = "friction_drift" in {one.kind for verdict in later.verdicts for one in verdict.evidence}
    assert drifts == (decide == "physics") or kind == "short"


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
