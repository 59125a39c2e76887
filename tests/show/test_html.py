"""The page: complete in itself, safe against hostile texts, and the same for every reader."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mavhums.app.analysis import analyse
from mavhums.engine.events import Notice
from mavhums.health.decision.events import Indication, Trace
from mavhums.results.assessment import Assessment
from mavhums.results.sections import VehicleUsage
from mavhums.results.verdict import Coverage, Evidence, Suspect, Verdict
from mavhums.show.blocks import Craft
from mavhums.show.curves import Curve, EvidenceCollector
from mavhums.show.evidence import CaptionedCurve, Limit
from mavhums.show.html import page
from mavhums.show.html_plot import plot
from mavhums.show.outline import DrawnSurface, outline, surfaces
from tests.conftest import REAL_LOGS, needs
from tests.flights import shown
from tests.present import present
from tests.serve.browser import BROWSER, Browser
from tests.show.conftest import new_assessment, new_verdict

HOSTILE = '<script>alert(1)</script><img src=x onerror="alert(2)">"\'&{{ 7*7 }}\x1b[31m\u202e'


class Tags(HTMLParser):
    """Every tag of a page with its attributes, and its texts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())


def indication(actuator: str = "elevator", fault: str = "friction", windows: int = 90) -> Indication:
    end = np.arange(10.0, 10.0 + windows)
    value = np.linspace(0.2, 1.0, windows)
    return Indication(1, actuator, fault, end, value, value - 0.03, value + 0.03)


def gathered(*events: Indication | Notice | Trace) -> EvidenceCollector:
    kept = EvidenceCollector()
    kept.consume(events)
    return kept


def with_limits(assessment: Assessment) -> Assessment:
    left, right, elevator, rudder = assessment.verdicts
    elevator = elevator.model_copy(update={"indicators": (shown(1.0, error=0.015, windows=9),)})
    return assessment.model_copy(update={"verdicts": (left, right, elevator, rudder)})


def test_the_answer_comes_first_and_answers_the_five_questions(assessment: Assessment) -> None:
    text = Tags(page(with_limits(assessment), gathered(indication()))).text
    answer = text[: text.index("Evidence")]
    for part in ("EMERGENCY: elevator: ", "What to do: ", "2025-06-01.tlog", "not an airworthiness decision"):
        assert part in answer
    found = text[text.index("Findings") :]
    for part in ("Since: 1m12s into the log (2025-06-01 10:01:12 UTC)", "1m12s to 1m40s: "):
        assert part in found
    for part in ("1.003 (0.973–1.033)", "91 of 91 s"):  # how sure
        assert part in text
    rows = text[text.index("Verdicts") : text.index("The aircraft from above")]
    assert rows.index("elevator") < rows.index("rudder") < rows.index("aileron_left")
    assert "1,234 bytes skipped" in text
    assert "0" * 64 in text


def test_a_plot_has_its_interval_its_limits_and_its_words(assessment: Assessment) -> None:
    tags = Tags(page(with_limits(assessment), gathered(indication())))
    assert "elevator: Coulomb friction, N·m" in tags.text
    assert "highest 1, lowest 0.2; degraded above 0.375; emergency from 0.875" in tags.text
    kinds = [attributes.get("class") for _, attributes in tags.tags]
    assert kinds.count("limit") == 2
    assert kinds.count("since") == kinds.count("band") == kinds.count("line") == 1
    line = next(a["d"] for _, a in tags.tags if a.get("class") == "line")
    assert present(line).count("L") == 89


def test_the_page_needs_nothing_from_elsewhere_and_runs_nothing(assessment: Assessment) -> None:
    tags = Tags(page(assessment, gathered(indication())))
    assert not {"script", "link", "img", "iframe", "object", "base", "form", "a"} & {
        tag for tag, _ in tags.tags
    }
    for _, attributes in tags.tags:
        assert not [name for name in attributes if name.startswith("on") or name in ("src", "href")]
    policy = next(a["content"] for _, a in tags.tags if a.get("http-equiv") == "Content-Security-Policy")
    assert present(policy).startswith("default-src 'none'")


def hostile(text: str) -> str:
    rule = new_verdict("elevator", "emergency").evidence[0].model_copy(update={"rule": text})
    said = {"actuator": f"elevator {text}", "evidence": (rule,), "reason": text, "remedy": text}
    odd = new_verdict("elevator", "emergency", 1.0, 5.0, **said)
    yaw = new_verdict("rudder", "normal", subject="axis", actuator="yaw", surfaces=(f"rudder {text}",))
    log = new_assessment().log.model_copy(update={"path": f"logs/{text}"})
    whole = new_assessment(odd, yaw, log=log, airframe=text)
    return page(whole, gathered(Notice(1.0, 1, text), indication(f"elevator {text}")))


@settings(max_examples=15)
@given(text=st.text(min_size=1, max_size=60))
@example(text=HOSTILE)
def test_any_text_stays_text_and_leaves_the_structure_as_it_is(text: str) -> None:
    written = hostile(text)
    tags, plain = Tags(written), Tags(hostile("harmless"))
    assert [tag for tag, _ in tags.tags] == [tag for tag, _ in plain.tags]
    assert [set(a) for _, a in tags.tags] == [set(a) for _, a in plain.tags]
    assert text != HOSTILE or text[: text.index("\"'&")] in tags.text
    assert "\x1b" not in written
    assert "\u202e" not in written


def test_long_flights_and_crowds_stay_small() -> None:
    names = [f"elevator_{k}" for k in range(300)]
    verdicts = [
        new_verdict("elevator", "emergency", 1.0 + k / 100, actuator=name) for k, name in enumerate(names)
    ]
    kept = EvidenceCollector()
    for name in names[:40]:
        kept.consume([indication(name, windows=20_000)])
    kept.consume(Notice(float(k), 1, "x" * 5000) for k in range(5000))
    written = page(new_assessment(*verdicts), kept)
    assert len(written.encode()) < 3_000_000
    text = Tags(written).text
    assert "100 more, less grave" in text
    assert "60 of 5000" in text


def test_a_pause_is_not_bridged_and_levels_lie_where_they_belong() -> None:
    time_s = np.concatenate([np.arange(10.0, 50.0), np.arange(200.0, 240.0)])
    rows = np.tile([0.4, 0.5, 0.6], (80, 1))
    drawn = plot(CaptionedCurve(1, "", "", Curve(time_s, rows), (Limit(1.0, "limit"),)), 240.0)
    assert (drawn.line.count("M"), drawn.band.count("Z")) == (2, 2)
    (level,) = drawn.limits
    value = float(drawn.line.split("L")[0].split()[1])
    zero = drawn.bottom
    assert (zero - value) / (zero - level.at) == pytest.approx(0.5, abs=0.01)
    single = plot(CaptionedCurve(1, "", "", Curve(np.array([5.0]), np.array([[0.0, 0.0, 0.0]]))), 0.0)
    assert single.line.count("L") == 1


def drawn_of(*verdicts: Verdict, usage: tuple[VehicleUsage, ...] = ()) -> list[DrawnSurface]:
    return outline(surfaces(new_assessment(*verdicts, usage=usage), 1))


def test_a_surface_has_the_condition_of_what_is_known_of_it() -> None:
    silent = new_verdict("elevator", "undecided", 0.0, None, condition="unmonitored", worst="unmonitored")
    axis: dict[str, object] = {"subject": "axis", "actuator": "pitch", "surfaces": ("elevator",)}
    pitch = new_verdict("elevator", "emergency", 0.2, 5.0, **axis)
    motor = new_verdict("elevator", "normal", 0.2, 0.0, actuator="motor_1")
    (part,) = drawn_of(silent, pitch, motor)
    assert (part.name, part.condition) == ("elevator", "emergency")
    inferred = pitch.model_copy(update={"surfaces": ("servo 2 (moves with pitch)",)})
    (part,) = drawn_of(inferred)
    assert (part.name, part.by, part.condition) == ("servo 2", "pitch control", "emergency")
    unknown = pitch.model_copy(update={"actuator": "yaw", "surfaces": ()})
    assert [(part.by, part.condition) for part in drawn_of(unknown)] == [("yaw control", "emergency")]
    assert drawn_of(unknown.model_copy(update={"condition": "undecided", "worst": "undecided"})) == []


def test_a_surface_that_profile_and_parameters_name_is_drawn_once() -> None:
    own = new_verdict("aileron_left", "normal")
    axis: dict[str, object] = {"subject": "axis", "actuator": "roll", "surfaces": ("left aileron (servo 1)",)}
    roll = new_verdict("aileron_left", "emergency", 0.2, 5.0, **axis)
    output = {
        "servo": 1, "name": "aileron_left", "named_by": "profile", "commanded": True, "range_us": None,
        "least_us": 1000, "greatest_us": 2000, "span": None, "travelled_us": 1, "travelled": None,
        "reversals": 1, "held_s": 1.0, "at_low_s": None, "at_high_s": None, "mean_us": None,
    }  # fmt: skip
    flown = {"kind": None, "firmware": None, "armed_s": None, "forward_s": 0.0}
    used = VehicleUsage.model_validate({"vehicle": 1, "outputs": (output,), **flown})
    (part,) = drawn_of(own, roll, usage=(used,))
    assert (part.name, part.by, part.condition) == ("aileron_left", "roll control", "emergency")


def test_labels_are_beside_the_curve_and_apart() -> None:
    curve = Curve(np.arange(10.0), np.tile([0.4, 0.5, 0.6], (10, 1)))
    limits = Limit(0.65, "emergency up to"), Limit(0.66, "degraded below")
    drawn = plot(CaptionedCurve(1, "", "", curve, limits), 10.0)
    assert [label.text for label in drawn.labels] == ["degraded", "emergency"]
    upper, lower = (label.at for label in drawn.labels)
    assert lower - upper == pytest.approx(20)
    assert abs(drawn.limits[0].at - drawn.limits[1].at) < 5, "the lines stay where they belong"


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no browser; Debian has one in the package chromium")
def test_a_browser_opens_it_from_disk_without_a_network(assessment: Assessment, tmp_path: Path) -> None:
    assert BROWSER is not None
    usual, odd = tmp_path / "report.html", tmp_path / "odd.html"
    usual.write_text(page(with_limits(assessment), gathered(indication())), encoding="utf-8")
    markup = "<img src=x onerror='window.alarmed=true'><script>window.alarmed=true</script>" + "w" * 200
    odd.write_text(hostile(markup), encoding="utf-8")
    lengths = "[...document.querySelectorAll('svg[data-plot] path.line')].map(p => p.getTotalLength())"
    with Browser(BROWSER) as browser:
        browser.call("Network.enable")
        nothing = {"latency": 0, "downloadThroughput": 0, "uploadThroughput": 0}
        browser.call("Network.emulateNetworkConditions", offline=True, **nothing)
        for file in (usual, odd):
            for width in (1200, 900, 800, 390):
                browser.size(width)
                browser.open(file.as_uri())
                assert browser.js("document.documentElement.scrollWidth") <= width, "it scrolls sideways"
                assert "EMERGENCY" in browser.js("document.querySelector('h1').innerText")
                [drawn] = browser.js(lengths)
                assert drawn > 100
                assert browser.js("window.alarmed === undefined")
                assert browser.js("performance.getEntriesByType('resource').length") == 0
        assert browser.errors == []


@pytest.mark.parametrize(
    ("fault", "axis", "kind", "words"),
    [
        ("tracking", "pitch", "pitch_angle", "pitch angle, °"),
        ("hard_over", "yaw", "response", "side force, m/s²"),
    ],
)
def test_an_alarm_shows_what_was_asked_against_what_was_flown(
    fault: str, axis: str, kind: str, words: str
) -> None:
    time_s = np.arange(0.0, 34.0, 0.25)
    demand = np.where(time_s < 20.0, 0.0, 45.0)
    demand[:4] = np.nan
    values = np.stack([demand, np.zeros(time_s.size)], axis=1)
    trace = Trace(1, axis, kind, time_s, np.radians(values) if "°" in words else values, (3, 14))
    evidence = Evidence(kind=fault, start_s=22.0, end_s=33.0, value=9.1, limit=8.0, rule="emergency: away")
    verdict = new_verdict(
        "elevator", "emergency", 0.2, 22.0, subject="axis", actuator=axis, evidence=(evidence,),
        suspects=(Suspect(fault=fault, confidence=0.99),), friction_nm=None, network=None,
        coverage=Coverage(moving_fraction=0.0, windows=34, decidable=0),
    )  # fmt: skip
    parsed = Tags(page(new_assessment(verdict), gathered(trace)))
    assert [tag for tag, attributes in parsed.tags if attributes.get("class") == "demand"] == ["path"]
    assert f"{axis} control: {words}" in parsed.text
    assert "farthest apart at 22.0s, by 45" in parsed.text
    assert [tag for tag, attributes in parsed.tags if attributes.get("class") == "reference"] == ["rect"]
    assert "0 of 34" not in parsed.text
    assert "9.1 times the healthy scatter, limit 8.0" in parsed.text


def test_every_alarm_of_an_actuator_shows_its_curve_though_it_has_passed() -> None:
    evidence = Evidence(kind="backlash", start_s=12.0, end_s=33.0, value=2.0, rule="emergency: play")
    verdict = new_verdict("elevator", "normal", evidence=(evidence,))
    parsed = Tags(page(new_assessment(verdict), gathered(indication(fault="backlash"))))
    assert "elevator: backlash" in parsed.text


@needs(REAL_LOGS / "alfa")
@pytest.mark.parametrize(
    "log",
    [
        "2018-09-11-17-27-13_2_both_ailerons_failure.tlog",
        "2018-09-11-14-41-51_elevator_failure.tlog",
        "2018-09-11-15-06-34_1_rudder_right_failure.tlog",
    ],
)
def test_each_alarm_of_a_real_flight_shows_its_curve(log: str, tmp_path: Path) -> None:
    assessment = analyse(REAL_LOGS / "alfa" / log, report=tmp_path / "report.html")
    parsed = Tags((tmp_path / "report.html").read_text(encoding="utf-8"))
    alarmed = [one for one in assessment.verdicts if one.worst == "emergency"]
    assert alarmed
    titles = re.findall(r"(\w+) control: (?:evidence of|side force|roll rate|\w+ angle)", parsed.text)
    assert titles[0] == assessment.ranked()[0].actuator
    assert {verdict.actuator for verdict in alarmed} <= {*titles}


def test_no_side_is_drawn_that_the_log_does_not_name() -> None:
    roll = Verdict(subject="axis", vehicle=1, actuator="roll", condition="emergency", worst="emergency")
    unnamed = roll.model_copy(update={"surfaces": ("aileron (servo 1)", "aileron (servo 9)")})
    parts = drawn_of(unnamed)
    assert [len(part.points) for part in parts] == [2, 2]
    assert len({corners for part in parts for corners in part.points}) == 4, "none hides another"
    assert "does not name its side" in Craft("", parts, ()).note
    named = roll.model_copy(update={"surfaces": ("aileron left (servo 1)", "aileron right (servo 2)")})
    left, right = drawn_of(named)
    assert left.x < right.x
    assert not Craft("", [left, right], ()).note
