"""The public surface and the contracts that users build on."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

import mavhums
import mavhums.results.assessment
from mavhums.core.errors import ExitCode
from mavhums.results.assessment import json_schema

ROOT = Path(__file__).parents[2]


def test_the_public_surface_is_what_it_says() -> None:
    assert set(mavhums.__all__) <= set(dir(mavhums))
    assert mavhums.__all__ == sorted(mavhums.__all__)
    for name in mavhums.__all__:
        if not name.endswith("Error") or name == "MavhumsError":
            assert ">>>" in str(getattr(mavhums, name).__doc__), f"{name} has no example"
    with pytest.raises(AttributeError, match="nonesuch"):
        mavhums.nonesuch  # noqa: B018


def modules() -> list[str]:
    found = []
    for base, package in ((ROOT, "mavhums"), (ROOT / "sim", "mavhums_sim")):
        for path in (base / package).rglob("*.py"):
            if path.stem != "__main__":
                parts = path.relative_to(base).with_suffix("").parts
                found.append(".".join(parts).removesuffix(".__init__"))
    return sorted(found)


def test_every_module_documents_its_names() -> None:
    silent = []
    for name in modules():
        try:
            module = importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name != "torch":
                raise
            continue
        own = {k: v for k, v in vars(module).items() if callable(v) and getattr(v, "__module__", "") == name}
        silent += [name] * (not module.__doc__)
        silent += [f"{name}.{k}" for k, v in own.items() if not k.startswith("_") and not v.__doc__]
    assert silent == []


def test_the_schema_file_is_generated_from_the_classes() -> None:
    assert mavhums.results.assessment._generate_schema() == json_schema()


def test_exit_codes_are_those_of_the_documentation() -> None:
    assert {code.name: int(code) for code in ExitCode} == {
        "OK": 0,
        "ERROR": 1,
        "USAGE": 2,
        "READ_WITH_LOSSES": 3,
        "NOT_SENT": 4,
        "DEGRADED": 10,
        "EMERGENCY": 11,
        "UNDECIDED": 12,
    }
