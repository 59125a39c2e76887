"""Data flows one way: import-linter's contracts in pyproject.toml hold, types and late imports included."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

pytest.importorskip("importlinter", reason="import-linter is an extra for development")

from importlinter.cli import lint_imports

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("contract", [each["id"] for each in PROJECT["tool"]["importlinter"]["contracts"]])
def test_imports_keep_the_contract(
    contract: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # it would disable every logger that exists, and with them the messages that later tests expect
    monkeypatch.setattr("logging.config.dictConfig", lambda _: None)
    status = lint_imports(
        config_filename=str(ROOT / "pyproject.toml"), limit_to_contracts=(contract,), no_cache=True
    )
    assert status == 0, capsys.readouterr().out


def test_every_module_lies_in_a_room() -> None:
    assert [path.name for path in sorted((ROOT / "mavhums").glob("*.py"))] == ["__init__.py", "__main__.py"]
