"""Earlier flights: their order, and the baselines that come out of them."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import Since
from mavhums.flights.history import PastFlight, baselines_of
from mavhums.flights.queries import earlier_flights
from mavhums.flights.store import Store
from mavhums.health.decision.baseline import Baseline, Baselines
from mavhums.health.estimation.thresholds import REFERENCE_FLIGHTS
from mavhums.results.assessment import Assessment
from tests.fleet.stores import write_store
from tests.flights import START, flown, identity, shown, verdict

KEY = (1, "elevator", "friction")
LATER = START + timedelta(days=10_000)


def baselines(flights: list[Assessment], before: datetime = LATER, since: Since | None = None) -> Baselines:
    return baselines_of([PastFlight.of(flight) for flight in flights], "paper", before, since)


def test_the_offset_from_utc_is_heeded() -> None:
    early = flown(verdict(), name="early")
    log = early.log.model_copy(update={"start_utc": "2026-03-01T11:00:00+03:00"})
    assert PastFlight.of(early.model_copy(update={"log": log})).start == START - timedelta(hours=1)


def test_a_date_that_is_none_is_quoted_up_to_sixty_characters() -> None:
    for said, quoted in (("x" * 60, "x" * 60), ("y" * 61, "y" * 60)):
        flight = flown(verdict(), name="odd")
        log = flight.log.model_copy(update={"start_utc": said})
        with pytest.raises(MavhumsError) as refused:
            PastFlight.of(flight.model_copy(update={"log": log}))
        expected = f"odd.tlog: log.start_utc '{quoted}' and the duration give no time"
        assert refused.value.problem == expected


def test_the_baseline_is_of_the_first_healthy_flights() -> None:
    values = np.linspace(0.2, 0.3, 40)
    flights = [flown(verdict(shown(value)), day=day) for day, value in enumerate(values)]
    sick = [
        flown(verdict(shown(0.9), condition="degraded"), day=3.1),
        flown(verdict(shown(0.9), condition="undecided"), day=3.2),
        flown(verdict(shown(0.9), suspect="friction"), day=3.3),
        flown(verdict(shown(0.9), actuator="rudder"), day=3.4),
        flown(verdict(shown(0.9), vehicle=2), day=3.5),
        flown(verdict(shown(0.9, fault="backlash")), day=30.6),
    ]
    found = baselines([*flights, *sick])
    reference = [shown(value) for value in values[:REFERENCE_FLIGHTS]]
    assert found[KEY] == Baseline.of(reference)
    assert set(found) == {KEY}


def test_neither_the_flight_itself_nor_a_later_one_is_its_baseline() -> None:
    flights = [flown(verdict(shown(0.2 + 0.01 * day)), day=day) for day in range(16)]
    found = baselines(flights, START + timedelta(days=13))
    assert found[KEY] == Baseline.of([shown(0.2 + 0.01 * day) for day in range(13)])
    during = baselines(flights, START + timedelta(days=12, seconds=300))
    assert during[KEY].flights == 12


def test_flights_of_another_profile_are_no_baseline() -> None:
    for other in ("other", "zebra", "paper plane", None):
        flights = [flown(verdict(shown(0.2)), day=day, airframe=other) for day in range(10)]
        assert baselines(flights) == {}
    both = [flown(verdict(shown(0.2)), day=day, airframe="other, paper") for day in range(10)]
    assert baselines(both)[KEY].flights == 10


def test_after_a_repair_the_baseline_begins_anew() -> None:
    flights = [
        flown(verdict(shown(0.2 + 0.1 * (day > 4))), verdict(shown(0.2), actuator="rudder"), day=day)
        for day in range(18)
    ]
    found = baselines(flights, since={"elevator": START + timedelta(days=5)})
    assert found[KEY].flights == 13
    assert found[KEY].mean == pytest.approx(0.3)
    assert found[1, "rudder", "friction"].flights == 18
    everyone = baselines(flights, since={None: START + timedelta(days=8)})
    assert {baseline.flights for baseline in everyone.values()} == {10}


def test_only_flights_of_one_profile_and_board_may_be_one_flight(tmp_path: Path) -> None:
    cases = (("0A", "paper"), ("0B", "paper"), (None, "paper"), ("0A", "other"), ("0A", "zebra"))
    a, *others = (
        flown(verdict(), name=name, airframe=airframe, identities=[identity(board=board)])
        for name, (board, airframe) in zip("abcde", cases, strict=True)
    )
    own = flown(verdict(), name="own", identities=[identity()])
    write_store(tmp_path / "store", {"D-A": [a, *others, own]})
    near = earlier_flights(Store(tmp_path / "store"), "D-A").near(PastFlight.of(own))
    assert [flight.path for flight in near] == ["a.tlog"]
