"""The lists of a fleet: the worst first, with words for everything."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from mavhums.core.conditions import Condition
from mavhums.flights.history import PastFlight
from mavhums.flights.trends import trend_report
from mavhums.results.standing import ActuatorTrend, LastFlightOf, RepairDate, Standing, TrendReport
from mavhums.results.verdict import Verdict
from mavhums.serve.pages import render, trends
from mavhums.serve.views import aircraft_table, flight_pages, flight_table, tally, trends_shown
from mavhums.show.blocks import Anchor, Mark
from tests.flights import flown, growth, left, shown, standing
from tests.flights import verdict as judged

MARKUP = "<img src=x onerror=alert(1)>"


def verdict(actuator: str, condition: Condition, reason: str | None = None, fault: str = "") -> Verdict:
    found = judged(actuator=actuator, condition=condition, suspect=fault or None)
    return found.model_copy(update={"reason": reason})


def last_flight(
    aircraft: str | None, log: str, start_utc: str | None, verdict: Verdict, standing: Standing | None = None
) -> LastFlightOf:
    return LastFlightOf(aircraft=aircraft, log=log, start_utc=start_utc, verdict=verdict, standing=standing)


def test_an_aircraft_is_shown_by_its_worst_and_the_order_is_kept() -> None:
    one, never = "2026-01-01T09:00:00+00:00", "1970-01-01T00:00:00+00:00"
    rows = [
        last_flight("D-B", "b.tlog", one, verdict("elevator", "emergency", fault="hard_over")),
        last_flight(None, "x/a.tlog", None, verdict("rudder", "undecided", "too slow")),
        last_flight(None, "x/c.tlog", None, verdict("rudder", "undecided", "too slow")),
        last_flight("D-B", "b.tlog", one, verdict("rudder", "normal")),
        last_flight("D-A", "a.tlog", never, verdict("rudder", "normal")),
    ]
    shown = aircraft_table(rows)
    first, unknown, other, well = shown.rows
    assert first[0] == [Anchor("D-B", "/fleet/aircraft?name=D-B")]
    assert first[1:3] == [[Mark("emergency")], "elevator: suspected: hard over"]
    assert first[3:] == ["1 emergency, 1 normal", "2026-01-01 09:00 UTC"]
    assert unknown[0] == [Anchor("unknown aircraft (a.tlog)", "")]
    assert unknown[2:] == ["rudder: too slow", "1 undecided", "date not known"]
    assert other[0] == [Anchor("unknown aircraft (c.tlog)", "")]
    assert well[2] == ""
    assert tally(shown) == [(Mark("emergency"), 1), (Mark("undecided"), 2), (Mark("normal"), 1)]


def test_what_grows_is_not_called_normal() -> None:
    grows = standing("normal", GROWS)
    shown = aircraft_table([last_flight("D-A", "a.tlog", None, verdict("rudder", "normal"), grows)])
    assert shown.rows[0][1:4] == [[Mark("changed", "grows")], f"rudder: {LIFE}", "1 grows"]


LIFE = (
    "friction grows by 0.005 N·m a flight since flight 3 (2026-03-03);"
    " 9 flights (5–14), about 2026-04-07, until degraded; more than 80 flights until emergency"
)


GROWS = growth(
    left(9.0, 5.2, 13.4).model_copy(update={"expected_utc": "2026-04-07"}),
    left(110.0, 80.0, 150.0).model_copy(update={"is_far": True}),
)


def test_flights_come_latest_first_and_lead_to_their_reports() -> None:
    flights = [flown(verdict("rudder", "normal"), day=day, name=f"/store/{day}") for day in (0, 1)]
    last, first = flight_table("D & A", flights).rows
    address = f"/fleet/flight?aircraft=D+%26+A&log={flights[1].log.sha256}"
    assert last[:2] == [[Anchor("2026-03-02 09:00 UTC", address)], [Mark("normal")]]
    assert first[3] == "0.tlog"
    assert flight_pages("D & A", map(PastFlight.of, flights))["2026-03-02T09:00:00+00:00"] == address


def trend(actuator: str, fault: str, *, grows: bool = False, last: float = 0.2) -> ActuatorTrend:
    values = [0.2] * 11 + [last]
    flights = [
        flown(judged(shown(value, fault=fault, error=0.05), actuator=actuator), day=day)
        for day, value in enumerate(values)
    ]
    (found,) = trend_report(map(PastFlight.of, flights)).trends
    fields = {"quantity": "play", "unit": "°", "limit": 0.5, "emergency": 0.9, "reason": "it does not grow"}
    return found.model_copy(update=fields | {"growth": GROWS if grows else None, "flights_left": None})


def test_the_trends_to_see_first_are_friction_what_grows_and_what_is_beyond_its_limit() -> None:
    trends = (
        trend("elevator", "friction"),
        trend("elevator", "backlash"),
        trend("rudder", "backlash", grows=True),
        trend("rudder", "bias", last=0.7),
    )
    report = TrendReport(flights=12, trends=trends, unshown=())
    elevator, rudder = trends_shown(report, ["2026-03-02T09:00:00+00:00"])
    assert (len(elevator.first), len(elevator.others)) == (1, 1)
    assert len(rudder.first) == 2
    shown = rudder.first[0].chart
    assert (shown["title"], shown["life"]) == ("play, °", LIFE)
    assert shown["caption"].startswith("flight 12: 0.2 (0.1 to 0.3) °, 95 % interval")
    assert elevator.first[0].chart["life"] == "It does not grow"
    (chart,) = json.loads(elevator.more.unescape())["charts"]
    assert (chart["title"], chart["life"]) == ("play, °", "It does not grow")
    assert [limit["name"] for limit in chart["limits"]] == ["degraded above", "emergency from"]
    assert chart["value"] == [0.2] * 12
    assert np.diff(chart["time"]).tolist() == [86_400_000.0] * 11, "a day"
    assert chart["links"] == [None, 0, *[None] * 10]


def test_repairs_are_marked_at_their_dates() -> None:
    first, last = (trend("elevator", "friction").points.start_utc[place] for place in (0, -1))
    repairs = (
        RepairDate(actuator=None, at_utc="2000-01-01T00:00:00+00:00"),
        RepairDate(actuator="elevator", at_utc=last),
        RepairDate(actuator="rudder", at_utc=last),
    )
    assert first < last
    trends = (trend("elevator", "friction"),)
    report = TrendReport(flights=12, trends=trends, unshown=(), repairs=repairs)
    (shown,) = trends_shown(report, [])[0].first
    (mark,) = shown.chart["marks"]
    assert mark == {"at": shown.chart["time"][-1], "text": f"repair {last[:10]}"}
    assert mark["text"] in shown.chart["caption"]


def test_texts_of_a_store_are_never_markup() -> None:
    aircraft = aircraft_table([last_flight(MARKUP, MARKUP, None, verdict(MARKUP, "undecided", MARKUP))])
    page: dict[str, Any] = {"title": "", "here": "", "pages": []}
    text = render("fleet.html", aircraft=aircraft, tally=tally(aircraft), problem="", more=False, **page)
    assert "<img" not in text
    assert text.count("&lt;img src=x") >= 3
    assert "<img" not in render("aircraft.html", name=MARKUP, problem=MARKUP, **page)
    named = trend(MARKUP, "friction").model_copy(update={"quantity": MARKUP})
    report = TrendReport(flights=12, trends=(named,), unshown=(MARKUP,))
    seen = {"problem": "", "query": "", "trends": trends(report, {}), "flights": flight_table(MARKUP, [])}
    text = render("aircraft.html", name=MARKUP, more=True, **page, **seen)
    assert "The latest 0 are listed" in text
    assert "<img" not in text
    assert text.count("&lt;img") >= 5
