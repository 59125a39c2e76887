from __future__ import annotations

import io
import re
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Literal

from rich.console import Console

import mavhums
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.log.base.decoder import Losses
from mavhums.results.assessment import Assessment
from mavhums.show.terminal import render
from tests.show.conftest import new_assessment, new_verdict

FLIGHTS = Path(__file__).parents[1] / "data"


def rendered(
    assessment: Assessment, *, width: int = 80, terminal: bool = False, verbose: bool = False
) -> str:
    file = io.StringIO()
    colours: Literal["auto", "truecolor"] = "truecolor" if terminal else "auto"
    console = Console(file=file, width=width, force_terminal=terminal, color_system=colours)
    render(assessment, console, verbose=verbose)
    return file.getvalue()


def flat(text: str) -> str:
    return " ".join(text.split())


def test_the_answer_first_then_the_worst_actuator_first(assessment: Assessment) -> None:
    lines = rendered(assessment).splitlines()
    assert lines[0] == "✖ EMERGENCY: elevator: friction 1.00 N·m (limit 0.875) since 1m12s"
    rows = [line.split()[0] for line in lines if " of 91 s" in line]
    assert rows == ["elevator", "aileron_left", "aileron_right"]
    elevator = next(line for line in lines if "91 of 91 s" in line)
    assert " ".join(elevator.split()) == "elevator ✖ EMERGENCY 1.003 (0.973–1.033) emergency 1m12s 91 of 91 s"


def test_colours_on_a_terminal_and_words_too(assessment: Assessment) -> None:
    text = rendered(assessment, terminal=True)
    codes = [re.search(rf"\x1b\[1;(3[0-9;]+)m. {word}", text) for word in ("EMERGENCY", "normal")]
    assert all(codes), "rich keeps a style's codes as the first terminal had them, so any colours will do"
    assert len({code[1] for code in codes if code}) == 2


def test_a_long_list_of_findings_is_cut_and_says_so() -> None:
    verdict = new_verdict("elevator", "emergency", 1.0, 5.0)
    many = verdict.model_copy(update={"evidence": verdict.evidence * 4})
    text = rendered(new_assessment(many))
    assert "… 6 earlier" in text
    assert text.count("(highest") == 2


def test_markup_and_control_codes_from_outside_are_inert() -> None:
    text = rendered(new_assessment(new_verdict("elevator", "undecided", actuator="[red]x\x1b[2J\x07")))
    assert not {"\x1b", "\x07"} & {*text}
    assert "[red]x�[2J� not judged" in text


SCREEN = 24


def sentences(assessment: Assessment) -> list[str]:
    """Return what a short answer says outside its table, sentence by sentence."""
    lines = rendered(assessment, width=1000).splitlines()
    text = "\n".join(line for line in lines if not line.startswith(" ") or line.startswith("  "))
    return [one.strip() for one in re.split(r"[.;] |\n|: ", text) if len(one.split()) > 4]


def assessments() -> Iterator[Assessment]:
    """Yield assessments of flights, and of every pair of conditions that an actuator and axes may have."""
    yield from map(mavhums.analyse, sorted(FLIGHTS.glob("*.tlog")))
    states: tuple[Condition, ...] = ("normal", "undecided", "degraded", "emergency", "changed", "learning")
    for one, other in product(states, states):
        elevator = new_verdict("elevator", one, 0.9, 5.0)
        rudder = new_verdict("rudder", other, 0.9, 5.0, subject="axis", friction_nm=None, evidence=())
        axes = [rudder.model_copy(update={"actuator": axis}) for axis in ("roll", "pitch", "yaw")]
        yield new_assessment(elevator, *axes, losses=Losses(bytes_skipped=9, damaged_regions=2))


def test_a_short_answer_is_read_in_ten_seconds() -> None:
    for assessment in assessments():
        text = rendered(assessment, width=100)
        lines, worst = text.splitlines(), assessment.ranked()[0]
        assert len(lines) <= SCREEN, text
        if all(SEVERITY[verdict.gravest] == 0 for verdict in assessment.verdicts):
            assert len(lines) <= SCREEN // 2, text
        assert len(sentences(assessment)) == len(set(sentences(assessment))), text
        head = flat(text).partition("What to do")[0]
        assert not re.search("lost [0-9.]+ %|damaged|skipped|airworthiness", lines[0]), text
        if SEVERITY[worst.gravest] > 0:
            assert worst.gravest.upper() in lines[0], text
            assert worst.actuator in head or any(one.surface in head for one in worst.candidates), text


def test_of_several_reasons_the_binding_one_is_shown() -> None:
    several = {"reason": "outputs at 2.9 Hz; 26 s of flight", "remedy": "record at 10 Hz; fly longer"}
    verdict = new_verdict("elevator", "undecided", 0.0, None, **several)
    brief, whole = rendered(new_assessment(verdict)), rendered(new_assessment(verdict), verbose=True)
    assert "elevator: undecided: outputs at 2.9 Hz (and 1 more: --verbose)" in flat(brief)
    assert "what to do: record at 10 Hz " in flat(brief) + " "
    assert "fly longer" not in brief
    assert all(text in flat(whole) for text in several.values())
