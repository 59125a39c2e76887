"""The study of a rig's recordings: splits that leak nothing, recordings that are refused, and its report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from mavhums.cli.main import cli
from mavhums.core.errors import MavhumsError
from mavhums.paper import real
from mavhums.paper.real import LOADS, MIXED, RUNS, STAGES, Size, splits
from mavhums.paper.rig import FEATURES, examples, read_rig

pytestmark = pytest.mark.slow
CONDITIONS = {"normal": 0.0, "play2": 0.15, "wear1": 0.05, "wear4": 0.3}


def sequence(rng: np.random.Generator, load: float, worse: float, constant: float) -> pd.DataFrame:
    time_s = np.arange(0.0, 13.0, 0.04)
    point = np.interp(time_s, (0.0, 5.0, 8.0, 13.0), (20.0, 140.0, 140.0, 20.0))
    way = np.where(time_s < 5.0, 1.0, np.where(time_s < 8.0, 0.0, -1.0))
    noise = rng.standard_normal((2, time_s.size))
    error = 2.0 * way + (0.25 + worse) * noise[0]
    current = constant + (0.5 + worse) * np.abs(way) + 0.005 * load * way + 0.02 * noise[1]
    return pd.DataFrame(
        {"time": time_s, "set_point": point, "position": point - error, "position_error": error,
         "current": current}
    )  # fmt: skip


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four conditions at two loads in six runs of three sequences; one run twice."""
    folder, rng = tmp_path_factory.mktemp("rig"), np.random.default_rng(1)
    for condition, worse in CONDITIONS.items():
        parts = []
        for load in (20, 40):
            for run in range(1, 7):
                constant = rng.uniform(0.3, 0.5)
                parts += [
                    sequence(rng, load, worse, constant).assign(load=load, run=run, sequence=k)
                    for k in range(1, 4)
                ]
        if condition == "play2":
            parts += [part.assign(run=7) for part in parts[:3]]
        pd.concat(parts).to_csv(folder / f"{condition}.csv.gz", index=False)
    return folder


def test_what_is_taken_off_is_gone_and_the_rest_stays(rig: Path) -> None:
    runs, repeated = read_rig(rig)
    assert repeated == ["play2, load 20, run 7"]
    recorded, run, stroke = (examples(runs, constants)[1] for constants in ("as recorded", "run", "stroke"))
    assert recorded.shape == (4 * 2 * 6 * 3, len(FEATURES))
    rest, out = FEATURES.index("current mean, rest 1"), FEATURES.index("current mean, out 1")
    assert recorded[:, rest].std() > 0.04
    assert run[:, rest].std() < 0.01
    assert run[:, out] == pytest.approx(recorded[:, out] - recorded[:, rest], abs=0.02)
    assert np.abs(stroke[:, out]).max() < 0.03
    error = [k for k, name in enumerate(FEATURES) if name.startswith("error")]
    assert (stroke[:, error] == recorded[:, error]).all()


def test_no_split_but_that_of_sequences_has_a_run_on_both_sides(rig: Path) -> None:
    table = examples(read_rig(rig)[0], "run")[0]
    seen = dict.fromkeys((MIXED, RUNS, LOADS, STAGES), 0)
    for split, train, test in splits(table, folds=3, seed=1):
        seen[split] = seen.get(split, 0) + 1
        assert not (train & test).any()
        shared = set(table.loc[train, "place"]) & set(table.loc[test, "place"])
        assert bool(shared) == (split == MIXED)
        if split == LOADS:
            assert not set(table.loc[train, "load"]) & set(table.loc[test, "load"])
        if split == STAGES:
            assert set(table.loc[test, "condition"]) == {"wear1", "normal"}
            assert set(table.loc[train, "condition"]) == {"normal", "play2", "wear4"}
    assert seen[MIXED] == seen[RUNS] == 3
    assert seen[LOADS] == 2
    assert seen[STAGES] == 1


def test_the_report_has_every_split_and_what_the_strokes_show(
    rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tiny = Size(folds=2, networks=5, trees=20, constants=("run",))
    monkeypatch.setattr(Size, "quick", classmethod(lambda _: tiny))
    split_once = {LOADS, STAGES}
    monkeypatch.setattr(
        real, "splits", lambda *given: [one for one in splits(*given) if one[0] in split_once]
    )
    outcome = CliRunner().invoke(cli, ["study", "real", str(rig), "-o", str(tmp_path), "--quick"])
    assert outcome.exit_code == 0, outcome.output
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "play2, load 20, run 7" in text
    found = pd.read_csv(tmp_path / "accuracies.csv")
    assert set(found["split"]) == split_once
    grave = pd.read_csv(tmp_path / "strokes.csv").set_index(["condition", "load"])
    found_in = dict(zip(grave.index, grave["any"], strict=True))
    assert found_in["wear4", 20].startswith("6/6")
    assert found_in["normal", 40].startswith("0/6")


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("normal", lambda table: None, "no table of the healthy rig"),
        ("wear1", lambda table: table.drop(columns="current"), "no column current"),
        ("wear1", lambda table: table.assign(load="much"), "column load has a cell that is no number"),
    ],
)
def test_what_is_no_such_recording_is_refused(
    rig: Path, tmp_path: Path, name: str, change: object, said: str
) -> None:
    for path in rig.iterdir():
        table = pd.read_csv(path)
        changed = change(table) if path.name.startswith(name) else table  # type: ignore[operator]
        if changed is not None:
            changed.to_csv(tmp_path / path.name, index=False)
    with pytest.raises(MavhumsError, match=said):
        read_rig(tmp_path)
