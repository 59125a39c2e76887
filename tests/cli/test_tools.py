"""Exported tables and the model's card, as a user meets them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import mavhums
from mavhums.core.errors import ExitCode
from mavhums.core.output import writer_for
from mavhums.core.quantities import KEYS
from mavhums.learn import default_model, save_model
from tests.conftest import Run
from tests.logs import heartbeat, write_log


def with_microseconds(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table with times in microseconds; pandas 2 reads them as nanoseconds."""
    return table.assign(time=table["time"].dt.as_unit("us"))


def test_exported_quantities_are_the_histories(run: Run, short_log: Path, tmp_path: Path) -> None:
    histories = mavhums.actuators(mavhums.read_log(short_log))
    outcome = run("export", short_log, "-o", tmp_path / "v.csv")
    assert outcome.code == 0
    assert outcome.out == f"{tmp_path}/v.csv: {sum(len(h.frame) for h in histories.values()):,} rows\n"
    table = with_microseconds(pd.read_csv(tmp_path / "v.csv", parse_dates=["time"]))
    assert list(table.columns) == ["vehicle", "actuator", "time", "flight_time_s", *KEYS]
    assert set(table["vehicle"]) == {1}
    for name, history in histories.items():
        own = table[table["actuator"] == name].set_index("time")
        assert own.index.equals(history.frame.index)
        assert own["flight_time_s"].is_monotonic_increasing
        pd.testing.assert_frame_equal(own[list(KEYS)], history.frame, check_freq=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", [None, *mavhums.models()])
def test_classified_samples_are_what_the_model_says_of_the_exported_quantities(
    run: Run, growing_log: Path, tmp_path: Path, name: str | None
) -> None:
    chosen = ["--model", name] if name else []
    assert run("export", growing_log, "-o", tmp_path / "c.csv", "--classify", *chosen).code == 0
    table = pd.read_csv(tmp_path / "c.csv")
    assert list(table.columns)[-3:] == ["p_emergency", "class", "inside"]
    model = mavhums.load_model(name or "paper-instrumented")
    values = table[list(KEYS)].to_numpy()
    carried = np.isfinite(values[:, [KEYS.index(key) for key in model.keys]]).all(axis=1)
    assert carried.mean() > 0.9
    written, answers = table[carried], model.classify(values[carried])
    expected = answers.probabilities[:, model.emergency]
    np.testing.assert_allclose(written["p_emergency"], expected, rtol=0, atol=1e-9)
    assert written["class"].tolist() == [model.classes[k] for k in answers.probabilities.argmax(axis=1)]
    assert written["inside"].tolist() == answers.inside.tolist()
    if name:  # without a name, another network may take the samples that lack one quantity
        assert table[~carried][["p_emergency", "class"]].isna().all(axis=None)
        assert not table[~carried]["inside"].any()


def test_what_no_network_covers_is_not_classified(run: Run, short_log: Path, tmp_path: Path) -> None:
    known, other = mavhums.load_model("paper-esc"), tmp_path / "mine.safetensors"
    card = known.card.model_copy(update={"airframe": "mine", "name": "my-net"})
    save_model(other, known.network, card, known.window)
    outcome = run("export", short_log, "-o", tmp_path / "c.csv", "--classify", "--model", other)
    assert outcome.code == ExitCode.ERROR
    assert "no network covers it: it carries V1, " in outcome.err
    assert "my-net takes V1, V5, V7 of mine" in outcome.err
    assert not (tmp_path / "c.csv").exists()


def test_parquet_holds_the_same_as_csv(run: Run, short_log: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    for arguments in ([], ["--messages", "ATTITUDE"], ["--messages", "STATUSTEXT"], ["--classify"]):
        csv, parquet = tmp_path / "t.csv", tmp_path / "t.parquet"
        assert run("export", short_log, "-o", csv, *arguments).code == 0
        assert run("export", short_log, "-o", parquet, *arguments).code == 0
        table = pd.read_parquet(parquet)
        assert str(table["time"].dtype) == "datetime64[us, UTC]"
        read = pd.read_csv(csv, parse_dates=["time"])
        pd.testing.assert_frame_equal(read, table, check_dtype=False, rtol=1e-6)


def test_long_tables_are_written_in_pieces(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    from pyarrow import parquet

    frame = pd.DataFrame({"x": np.arange(40_000), "text": "a"})
    for name in ("t.csv", "t.parquet"):
        path = tmp_path / name
        with writer_for(path)(path) as table:
            for _ in range(5):
                table.write(frame)
        assert table.rows == 200_000
    assert parquet.ParquetFile(tmp_path / "t.parquet").num_row_groups == 3
    assert len(pd.read_csv(tmp_path / "t.csv")) == 200_000


def test_several_messages_are_a_file_each(run: Run, short_log: Path, tmp_path: Path) -> None:
    out = tmp_path / "flight.csv"
    outcome = run("export", short_log, "-o", out, "--messages", "attitude, PARAM_VALUE,ATTITUDE")
    assert outcome.code == 0
    assert {path.stem for path in tmp_path.iterdir()} == {"flight-ATTITUDE", "flight-PARAM_VALUE"}
    log = mavhums.read_log(short_log)
    attitude = with_microseconds(pd.read_csv(tmp_path / "flight-ATTITUDE.csv", parse_dates=["time"]))
    pd.testing.assert_frame_equal(
        attitude.set_index("time"), log.messages["ATTITUDE"], check_dtype=False, rtol=1e-6, check_freq=False
    )
    assert "SERVO1_FUNCTION" in (tmp_path / "flight-PARAM_VALUE.csv").read_text()


def test_a_log_without_a_profile_or_without_telemetry_is_not_exported(run: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "x.tlog", [heartbeat(3)])
    assert "names no airframe profile" in run("export", log, "-o", tmp_path / "x.csv").err
    outcome = run("export", log, "-o", tmp_path / "x.csv", "--airframe", "paper")
    assert "contains no telemetry of the actuators of paper" in outcome.err
    assert [path.name for path in tmp_path.iterdir()] == ["x.tlog"]


def test_the_packaged_model_shows_its_card(run: Run) -> None:
    model = default_model()
    outcome = run("model", "show")
    assert outcome.code == 0
    for text in (model.card.name, model.hash, model.card.command, ", ".join(model.card.features)):
        assert text in outcome.out
    assert all(f" {key} " in outcome.out for key in model.card.selection.chi_square)
    for line in model.card.selection.stage_lines(model.card.features):
        assert " ".join(line.split()) in " ".join(outcome.out.split())


def test_commands_take_a_model_by_name(run: Run, short_log: Path) -> None:
    shown = json.loads(run("model", "show", "paper-esc", "--json").out)
    judged = json.loads(run("analyse", short_log, "--model", "paper-esc", "--json").out)
    assert shown["name"] == "paper-esc"
    assert judged["model"] == {"name": "paper-esc", "hash": shown["hash"]}


def test_a_card_is_json_for_scripts(run: Run, tmp_path: Path) -> None:
    model = default_model()
    path = tmp_path / "copy.safetensors"
    save_model(path, model.network, model.card, model.window)
    card = json.loads(run("model", "show", path, "--json").out)
    assert card["hash"] == model.hash
    assert card["features"] == list(model.card.features)
    assert card["selection"]["selected"] == list(model.card.selection.selected)
