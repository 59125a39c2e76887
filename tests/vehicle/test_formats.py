"""Only the rooms of the formats name messages, and their tables are consistent."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mavhums.actuator.telemetry import TIERS
from mavhums.log.formats import FORMATS as LOG_FORMATS
from mavhums.log.mavlink.dialect import load_dialect
from mavhums.vehicle import formats
from mavhums.vehicle.facts import REPORTS, SIGNALS
from mavhums.vehicle.formats import FORMATS, SERVO_SOURCES, messages_of
from mavhums.vehicle.formats.base import TEXT, FormatModule, holds
from tests.vehicle.tables import table_of

ROOM = Path(formats.__file__).parents[2]
KNOWS = (ROOM / "log", ROOM / "vehicle" / "formats")

WORDS = {"airspeed", "info", "parameter", "ESC", "GPS", "IMU", "RPM", "MODE", "POS", "STAT", "EVENT", "PING"}
"""Messages whose names are also words of the field: facts, kinds of telemetry, parts of a vehicle."""

RECORDS = {"BARO", "XKF1", "NKF1", "AHR2", "CTUN", "ERR", "VIBE"}
RECORDS |= {"sensor_baro", "vehicle_command", "battery_status"}
"""Messages of on-board logs that no table here reads."""


def messages(form: FormatModule) -> set[str]:
    return {source.message for source in form.SOURCES} | {source.message for source in form.SERVO_SOURCES}


def names_of_messages() -> set[str]:
    tables = set().union(*map(messages, FORMATS))
    dialect = {definition.name for definition in load_dialect().definitions.values()}
    return (tables | dialect | RECORDS) - WORDS


NAME = re.compile(rf"(?<![\w.])(?:{'|'.join(sorted(names_of_messages(), key=len, reverse=True))})(?!\w)")


def texts(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the texts of a module that are no docstrings, with their lines."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
            yield node.lineno, node.value


def test_nothing_else_names_a_message() -> None:
    others = [path for path in sorted(ROOM.rglob("*.py")) if not any(map(path.is_relative_to, KNOWS))]
    named = [
        f"{path.relative_to(ROOM)}:{line}: {NAME.findall(text)}"
        for path in others
        for line, text in texts(path)
        if NAME.search(text)
    ]
    assert not named, f"name the fact instead, and put the message into vehicle/formats: {named}"


def test_every_format_that_is_read_says_where_it_keeps_facts() -> None:
    modules = {path.stem for path in KNOWS[1].glob("*.py")} - {"__init__", "base", "mode_names", "px4_buses"}
    modules |= {path.parent.name for path in KNOWS[1].glob("*/__init__.py")}
    assert {form.NAME for form in FORMATS} == {known.name for known in LOG_FORMATS}
    assert {form.NAME for form in FORMATS} - {"tlog"} | {"mavlink"} == modules


@pytest.mark.parametrize("form", FORMATS, ids=lambda form: form.NAME)
def test_the_tables_name_known_facts_and_tiers(form: FormatModule) -> None:
    assert {source.fact for source in form.SOURCES} <= {*SIGNALS, *REPORTS}
    assert {source.tier for source in form.SERVO_SOURCES} <= {tier.name for tier in TIERS}
    assert form.REMEDIES.keys() == {"motion", "force"}


def test_no_message_is_of_two_formats() -> None:
    found = [messages(form) for form in FORMATS]
    assert sum(map(len, found)) == len(set().union(*found))


def test_every_fact_has_a_source_and_every_tier_its_messages() -> None:
    assert [fact for fact in (*SIGNALS, *REPORTS) if not messages_of(fact)] == []
    assert {tier.name for tier in TIERS} == {source.tier for source in SERVO_SOURCES}


def test_a_table_holds_fields_of_the_kind_and_the_width_that_are_read() -> None:
    fields = np.zeros(1, dtype=[("name", "S16"), ("id", "u1"), ("data", "f4", 3), ("raw", "V4")])
    table = table_of("ANY", fields)
    assert holds(table, {"name": TEXT, "id": 1, "data": 3})
    for field, width in (
        *(("name", 1), ("name", 16), ("id", TEXT), ("data", TEXT), ("raw", TEXT), ("raw", 1)),
        *(("id", 2), ("data", 1), ("other", 1), ("other", TEXT)),
    ):
        assert not holds(table, {field: width})
