"""What the site's hook fills in, and what it warns of: a strict build fails on a warning below "mkdocs"."""

from __future__ import annotations

import re
from types import SimpleNamespace

import pytest

import mavhums
from docs import hooks

CONFIG = {"extra": {"repository": "https://example.org/repo"}}


def filled(markdown: str, source: str = "guide/px4.md") -> str:
    return hooks.on_page_markdown(markdown, SimpleNamespace(file=SimpleNamespace(src_uri=source)), CONFIG)


@pytest.mark.parametrize("name", [name for name in hooks.schemas() if name != hooks.PROFILE])
def test_every_table_describes_every_field(name: str, caplog: pytest.LogCaptureFixture) -> None:
    text = filled(f"<!-- fields: {name} -->")
    assert text.startswith("##")
    assert "| field | type |" in text
    assert caplog.records == []


@pytest.mark.parametrize("page", ["profile-fields.md", "python.md"])
def test_profile_fields_and_public_names_are_read_in_the_repository_as_the_code_has_them(page: str) -> None:
    text = (hooks.DOCS / "reference" / page).read_text(encoding="utf-8")
    heads = [re.findall(r"^- `.*?: ", one, re.MULTILINE) for one in (hooks.renewed(text), text)]
    assert heads[0] == heads[1], "python docs/hooks.py renews it"
    keys = ["supply_voltage", "effectiveness_degraded"] if page == "profile-fields.md" else [*mavhums.__all__]
    assert [key for key in keys if f"`{key}`" not in text] == []


def test_a_field_without_a_description_and_a_description_without_a_field_are_warnings(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(hooks, "_descriptions", lambda: {"any": {"gone": "Nothing."}})
    hooks.profile()
    assert "Actuator.servo: give the field a description, or add it to fields.toml" in caplog.messages
    hooks.on_pre_build(CONFIG)
    assert caplog.messages[-1] == "fields.toml describes any.gone, which does not exist"
    assert {record.name.split(".")[0] for record in caplog.records} == {"mkdocs"}


def test_a_link_out_of_the_pages_becomes_an_address(caplog: pytest.LogCaptureFixture) -> None:
    text = "[a](../../README.md#x) [b](../method/axes.md) [c](profile.md) [d](https://x.org/../y)"
    wanted = "[a](https://example.org/repo/blob/main/README.md#x) " + text.split(" ", 1)[1]
    assert filled(text) == wanted
    assert caplog.messages == []
    filled("[a](../../nothing.md)")
    assert caplog.messages == ["guide/px4.md links to ../../nothing.md, which does not exist"]


def test_roles_of_docstrings_go() -> None:
    assert hooks.on_page_content("a :class:<code>~Model</code>: b") == "a <code>Model</code>: b"
