"""The results of the closed-loop benchmark: a run that was cut off is continued."""

from __future__ import annotations

import importlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("_flown_results")


def test_a_run_that_was_cut_off_is_continued(
    kept: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown = []

    def fly(planned: Any) -> Any:
        flown.append(planned.name)
        alarm = kept.Alarm("roll", "effectiveness", "degraded", 180.0)
        said = (("roll",), (alarm,), (), {"roll": "degraded"}, {"roll": 90}, 250, {"roll": 14.1})
        return kept.Result(planned.name, {"kind": "freeze", "streams_hz": "10"}, 170.0, 300.0, *said)

    monkeypatch.setattr(kept, "_fly", fly)
    plan = [SimpleNamespace(name=name) for name in ("a", "b", "c")]
    file, here = tmp_path / "results.jsonl", ThreadPoolExecutor(1)
    whole = [*kept.results(plan, here, file, 1)]
    assert flown == ["a", "b", "c"]
    lines = file.read_text().splitlines()
    file.write_text("\n".join(lines[:2]) + "\n" + lines[2][:40])
    again = [*kept.results(plan, here, file, 1)]
    assert flown == ["a", "b", "c", "c"]
    assert sorted(again, key=lambda row: row.name) == whole
    assert sorted(kept.results(plan, here, file, 1), key=lambda row: row.name) == whole
    assert len(flown) == 4
    more = [*plan, SimpleNamespace(name="d")]
    assert [row.name for row in kept.results(more, None, file, 1)] == ["a", "b", "c"]
