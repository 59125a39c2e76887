"""The table of messages: each row is used and asserted, has something to do, and names what exists."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from mavhums.results.reasons import MESSAGES, Reason, said
from tests.docs.test_reference import COMMANDS

ROOT = Path(__file__).parents[2]
WITHOUT_REMEDY = {"own_unchanged", "propeller_escs", "no_angle"}
"""Nothing is wrong, or another reason of the same verdict has the remedy."""


@pytest.mark.parametrize("folder", ["mavhums", "tests"])
def test_each_row_is_used_by_a_room_and_asserted_by_a_test(folder: str) -> None:
    texts = set()
    for path in (ROOT / folder).rglob("*.py"):
        if path.name not in ("reasons.py", Path(__file__).name) or path.parent.name == "verdict":
            tree = ast.parse(path.read_text(encoding="utf-8"))
            texts |= {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    assert MESSAGES.keys() - texts == set()


def test_each_reason_has_something_to_do_with_commands_and_options_that_exist() -> None:
    options = {name for command in COMMANDS.values() for one in command.params for name in one.opts}
    for code, (text, remedy) in MESSAGES.items():
        assert bool(remedy) is (code not in WITHOUT_REMEDY), code
        assert "; " not in text or code.startswith("own_"), "it would be cut where few texts fit"
        assert set(re.findall(r"--[a-z-]+", f"{text} {remedy}")) <= options, code
        calls = re.findall(r"mavhums [a-z]+(?: new)?", remedy)
        assert set(calls) <= COMMANDS.keys(), code


def test_several_reasons_are_given_once_each_the_binding_one_first() -> None:
    still, short = Reason("own_still", quantity="friction"), Reason("telemetry_too_short", needed_s=10)
    assert said(short, still, short) == {
        "reason": f"{short.text}; {still.text}",
        "remedy": f"{short.remedy}; {still.remedy}",
        "reason_codes": (short.code, still.code),
    }
    assert said() == {"reason": None, "remedy": None, "reason_codes": ()}
