"""However a log is cut into blocks, verdicts and events are the same."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavhums.engine.events import Event
from mavhums.health.decision.events import Classified
from mavhums.learn import packaged_models
from mavhums.results.assessment import Assessment
from mavhums_sim import Flight, fly
from mavhums_sim.rover import SteeringFault, encoded
from tests.conftest import carried_logs
from tests.engine.test_axes import flown
from tests.engine.test_contradicted_profile import NAMED, PAPER, SWAPPED
from tests.engine.test_engine import TIERS, packed
from tests.engine.test_events import canonical, two_vehicles
from tests.engine.test_steering import driven
from tests.engine.test_traces import hovered
from tests.engine.wired import Wired
from tests.judge import judged
from tests.strategies import blocks, cuts


def simulated(**flight: Any) -> bytes:
    return b"".join(data for _, data in packed(fly(Flight(rate_hz=20.0, **flight))))


DRAWN = {"vehicle_states": True}
LOGS: dict[str, tuple[Callable[[], bytes], dict[str, Any]]] = {
    "two vehicles": (two_vehicles, DRAWN),
    "networks": (lambda: simulated(seed=12, duration_s=15.0), {"models": packaged_models()}),
    "decided by the network": (
        lambda: simulated(seed=11, duration_s=40.0, friction_nm={"elevator": (0.2, 1.2)}),
        {"models": packaged_models(), "decide": "network"} | DRAWN,
    ),
    "tiers": (
        lambda: simulated(seed=23, duration_s=25.0, friction_nm={"elevator": (1.0, 1.0)}, tiers=TIERS[2:]),
        {"models": packaged_models()},
    ),
    "axes": (flown, DRAWN),
    "late": (Wired(seconds=130, sent_s=97.3, texts=NAMED).tlog, {}),
    "motion": (Wired(seconds=130, parameters={}).tlog, {"airframe": PAPER}),
    "withdrawn": (Wired(seconds=150, coordinated_s=100.0, sent_s=120.4).tlog, {"airframe": SWAPPED} | DRAWN),
    "rover": (lambda: encoded(driven(SteeringFault(200.0, 0.5))), DRAWN),
    "quad": (lambda: hovered(0.5), DRAWN),
    **{path.name: (path.read_bytes, {}) for path in carried_logs()},
}


@cache
def whole(name: str) -> tuple[bytes, Assessment, dict[Any, Any]]:
    made, options = LOGS[name]
    content = made()
    assessment, events = judged([content], **options)
    return content, assessment, canonical(all_events(assessment, events))


def all_events(assessment: Assessment, events: list[Event]) -> list[Event]:
    """Return all events but the answers to single samples, whose last digits may differ."""
    kept = [event for event in events if not isinstance(event, Classified)]
    return kept + cast(list[Event], [*assessment.events])


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name != "two vehicles")) for name in LOGS]
)
@given(data=st.data())
@settings(max_examples=2)
def test_neither_a_verdict_nor_an_event_depends_on_the_blocks(name: str, data: st.DataObject) -> None:
    content, assessment, events = whole(name)
    again, pieces = judged(blocks(content, data.draw(cuts(len(content)))), **LOGS[name][1])
    assert again.to_json() == assessment.to_json()
    assert canonical(all_events(again, pieces)) == events
