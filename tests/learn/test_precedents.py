from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mavhums.core.quantities import KEYS
from mavhums.learn import PrecedentBase, PrecedentError, Provenance
from mavhums.learn.precedents import read_labels

PROVENANCE = Provenance(
    log="flight.tlog", sha256="ab" * 32, vehicle=1, actuator="elevator", airframe="paper",
    tier="instrumented", label="normal", origin="flown",
)  # fmt: skip
VALUES = np.random.default_rng(0).normal(size=(50, 12))
VALUES[:, 10] = np.nan
MEASURED = np.random.default_rng(1).random(VALUES.shape) < 0.5
TIME = 1_700_000_000_000_000 + 10_000 * np.arange(50)


def test_what_is_added_comes_back_with_its_provenance(tmp_path: Path) -> None:
    base = PrecedentBase(tmp_path / "base")
    added = base.add(PROVENANCE, TIME, VALUES, MEASURED)
    assert list(base) == [added]
    assert (added.provenance, added.samples) == (PROVENANCE, 50)
    time_s, values, measured = base.read(added)
    np.testing.assert_array_equal(values, VALUES)
    np.testing.assert_array_equal(measured, MEASURED)
    np.testing.assert_allclose(time_s, 0.01 * np.arange(50))
    assert [path.name for path in base.folder.iterdir()] == [added.path.name]


def test_every_row_says_where_it_comes_from(tmp_path: Path) -> None:
    frame = pd.read_parquet(PrecedentBase(tmp_path).add(PROVENANCE, TIME, VALUES, MEASURED).path)
    assert list(frame.columns)[:13] == ["time", *KEYS]
    assert frame["time"].iloc[0] == pd.Timestamp(TIME[0], unit="us", tz="UTC")
    assert set(frame["label"]) == {"normal"}
    assert set(frame["log"]) == {"flight.tlog"}
    assert set(frame["origin"]) == {"flown"}


def test_the_same_log_again_replaces_and_another_actuator_adds(tmp_path: Path) -> None:
    base = PrecedentBase(tmp_path)
    base.add(PROVENANCE, TIME, VALUES, MEASURED)
    base.add(replace(PROVENANCE, label="friction_emergency"), TIME[:9], VALUES[:9], MEASURED[:9])
    base.add(replace(PROVENANCE, actuator="rudder"), TIME, VALUES, MEASURED)
    found = {(one.provenance.actuator, one.provenance.label): one.samples for one in base}
    assert found == {("elevator", "friction_emergency"): 9, ("rudder", "normal"): 50}


def test_damage_and_absence_are_said(tmp_path: Path) -> None:
    with pytest.raises(PrecedentError, match="no precedent base there: add to one with"):
        list(PrecedentBase(tmp_path / "absent"))
    bad = tmp_path / "bad.parquet"
    pd.DataFrame({"label": ["normal"]}).to_parquet(bad)
    foreign = bad.read_bytes()
    bad.unlink()
    whole = PrecedentBase(tmp_path).add(PROVENANCE, TIME, VALUES, MEASURED).path
    pd.read_parquet(whole).drop(columns="V2_measured").to_parquet(bad)
    whole.unlink()
    for content in (bad.read_bytes(), foreign, b"PAR1 nonsense"):
        bad.write_bytes(content)
        with pytest.raises(PrecedentError, match=r"bad\.parquet: not a precedent"):
            list(PrecedentBase(tmp_path))


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(PrecedentError, match="cannot write"):
        PrecedentBase(tmp_path / "file").add(PROVENANCE, TIME, VALUES, MEASURED)
    with pytest.raises(ValueError, match="shape"):
        PrecedentBase(tmp_path).add(PROVENANCE, TIME, VALUES[:, :3], MEASURED)


def test_a_base_of_two_classes_is_read_as_it_was(tmp_path: Path) -> None:
    """Bases of earlier versions have the paper's class, emergency."""
    base = PrecedentBase(tmp_path)
    path = base.add(PROVENANCE, TIME, VALUES, MEASURED).path
    pd.read_parquet(path).assign(label="emergency").to_parquet(path)
    assert [each.provenance.label for each in base] == ["friction_emergency"]


def test_a_table_labels_many_logs(tmp_path: Path) -> None:
    table = tmp_path / "labels.csv"
    rows = "log,actuator,label\nflights/a.tlog,,normal\na.tlog,rudder, backlash\nb.tlog,elevator,emergency\n"
    table.write_text(rows, encoding="utf-8-sig")
    assert read_labels(table) == {
        "a.tlog": {"": "normal", "rudder": "backlash"},
        "b.tlog": {"elevator": "friction_emergency"},
    }


@pytest.mark.parametrize(
    ("rows", "problem"),
    [
        ("log,label\na.tlog,broken\n", "2: no condition is named 'broken': name one of: normal, friction_"),
        ("log,label\na.tlog,normal\na.tlog,jam\n", "3: another row labels a.tlog differently"),
        ("file,label\na.tlog,normal\n", "2: names no log or no label"),
        ('log,label\n"a.tlog,normal\n', "no readable table"),
    ],
)
def test_a_table_with_a_mistake_names_its_place(rows: str, problem: str, tmp_path: Path) -> None:
    (tmp_path / "labels.csv").write_text(rows)
    with pytest.raises(PrecedentError, match=problem):
        read_labels(tmp_path / "labels.csv")
