"""The line of each key of a TOML text."""

from __future__ import annotations

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums.actuator.profile_checks import line_of

TEXT = '''# a comment, and a [header] in it
name = "x"  # = [no]
note = """
[[actuators]]
servo = 9
"""

[[actuators]]
servo = 1
pwm = [
  1000, # [[nothing]]
  1500,
]
ema.ratio = 300
fields.V3 = { message = "M", field = "f" }
[actuators.limits]
normal = 0.3

[[actuators]]
"quoted key" = 2
[actuators.fields.V1]
message = 'N'
[[actuators.part]]
id = 1
[[actuators.part]]
id = 2
[actuators.part.inner]
x = 1
'''


PLACES = {
    "name": 2, "note": 3, "actuators/0": 8, "actuators/0/servo": 9, "actuators/0/pwm": 10,
    "actuators/0/ema/ratio": 14, "actuators/0/fields/V3/field": 15, "actuators/0/limits": 16,
    "actuators/0/limits/normal": 17, "actuators/1/quoted key": 20, "actuators/1/fields/V1/message": 22,
    "actuators/1/part/1/id": 26, "actuators/1/part/1/inner/x": 28,
}  # fmt: skip


@pytest.mark.parametrize(("place", "line"), PLACES.items())
def test_places_have_the_line_on_which_they_begin(place: str, line: int) -> None:
    assert line_of(tuple(int(key) if key.isdigit() else key for key in place.split("/")), TEXT) == line


KEYS = st.text("abc-_", min_size=1, max_size=3)
VALUES = st.sampled_from(["1", '"a = [b]"', "[\n1,\n2\n]", "'''\n[x]\n'''", "{ p = 1 }", "true"])


@given(st.dictionaries(KEYS, st.dictionaries(KEYS, VALUES, max_size=4), max_size=4))
def test_every_key_of_a_text_is_found_where_it_was_written(tables: dict[str, dict[str, str]]) -> None:
    text = ""
    expected: dict[tuple[str, ...], int] = {}
    for table, entries in tables.items():
        expected[(table,)] = text.count("\n") + 1
        text += f"[{table}]\n"
        for key, value in entries.items():
            expected[table, key] = text.count("\n") + 1
            text += f"{key} = {value}\n"
    assert tomllib.loads(text).keys() == tables.keys()
    assert {place: line_of(place, text) for place in expected} == expected
