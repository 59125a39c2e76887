"""The study from its command line: complete, honest about its split, and fast enough when quick."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from mavhums.cli.main import cli
from mavhums.core.quantities import KEYS
from mavhums.learn import wrapper
from mavhums.paper.experiment import Effort

pytestmark = pytest.mark.slow
TINY = Effort(networks=3, iterations=40, every=20)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("study") / "report"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Effort, "quick", classmethod(lambda _: TINY))
        sizes = {"_SAMPLES": 200, "_ITERATIONS": 10, "_SHORTLIST": 2, "_COMPARED_ITERATIONS": 20, "_SEEDS": 1}
        for name, value in sizes.items():
            patch.setattr(wrapper, name, value)
        outcome = CliRunner().invoke(cli, ["study", "paper", "-o", str(out), "--quick"])
    assert outcome.exit_code == 0, outcome.output
    assert outcome.output.splitlines() == [str(out / path.name) for path in map(Path, outcome.output.split())]
    return out


def test_every_file_is_there_and_none_is_left_half_written(folder: Path) -> None:
    assert {path.name for path in folder.iterdir()} == {
        "report.md", "table-1.csv", "figure-15-chi-square.csv", "networks.csv", "flights.csv",
        "moving-fraction.csv", "figures-3-14.png",
        "figure-15-groups.csv", "weight-decay.csv", "statements.csv",
        "load-friction.csv", "figures-16-19.png",
    }  # fmt: skip


def test_the_report_holds_every_table_and_figure_of_the_paper(folder: Path) -> None:
    text = (folder / "report.md").read_text(encoding="utf-8")
    for part in (
        "Table 1,", "The split", "Figures 3 to 14", "Figure 15", "Figure 1: the whole scheme", "wrapper: ",
        "Tables 4 and 5", "Accuracy and motion", "Figures 16 to 19", "A quick run",
        "What the paper says", "| take-off | V2 V5 V9 V11 | 0 |", "| pilot ±20° | V5 V11 | 0.0001 |",
    ):  # fmt: skip
        assert part in text, part
    assert re.search(r"samples of the take-off \d\d\.\d % are in motion", text)
    for name in re.findall(r"!\[[^]]*\]\(([^)]+)\)", text):
        assert (folder / name).is_file()
    for figure in ("96.70", "98.01", "41807.3", "98.00"[:4]):
        assert figure in text


def test_the_networks_are_tested_on_flights_that_they_never_saw(folder: Path) -> None:
    flights = pd.read_csv(folder / "flights.csv")
    main = flights[flights["inputs"] == " ".join(KEYS)].groupby("cyclogram")
    assert len(main) == 2
    for _, part in main:
        assert set(part.loc[part["role"] == "training", "friction_nm"]) == {0.225, 1.025}
        tested = {0.275, 0.325, 0.375, 0.875, 0.925, 0.975}
        assert set(part.loc[part["role"] == "test", "friction_nm"]) == tested


def test_each_statement_is_judged_at_every_weight_decay(folder: Path) -> None:
    """A network without decay is another than one with; a verdict follows from the figures beside it."""
    decays = pd.read_csv(folder / "weight-decay.csv")
    takeoff = decays[decays["cyclogram"] == "take-off"].set_index(["inputs", "weight decay"])
    best = takeoff[f"best of {TINY.networks} by test"].to_dict()
    every = (0, 1e-6, 1e-4, 1e-2)
    assert len({best["V1–V12", decay] for decay in every}) > 1
    said = pd.read_csv(folder / "statements.csv").set_index("the paper says")
    gains = said.loc["these four gain 1.31 points"].to_dict()
    for decay in every:
        gain = best["V2 V5 V9 V11", decay] - best["V1–V12", decay]
        assert float(gains[f"decay {decay:g}"]) == pytest.approx(gain, abs=0.006)
    held = [float(gains[f"decay {decay:g}"]) >= 0.5 for decay in every]
    wanted = "confirmed" if all(held) else "depends on the weight decay" if any(held) else "not confirmed"
    assert gains["verdict"] == wanted
    assert len(said) == 7


def test_the_choice_without_test_data_is_the_smallest_training_loss(folder: Path) -> None:
    networks = pd.read_csv(folder / "networks.csv")
    for _, part in networks.groupby(["cyclogram", "inputs"]):
        assert len(part) == TINY.networks
        assert part["loss"].to_numpy()[part["chosen"].to_numpy()].tolist() == [part["loss"].min()]


def test_linear_pairs_score_alike_and_the_command_scores_nothing(folder: Path) -> None:
    table = pd.read_csv(folder / "figure-15-chi-square.csv").set_index("quantity")
    for one, other in (("V2", "V3"), ("V5", "V8"), ("V7", "V10")):
        np.testing.assert_allclose(table.loc[one].to_numpy(), table.loc[other].to_numpy(), rtol=0.05, atol=1)
    assert (table.loc["V1"].drop("paper") == 0).all()
    assert table["training 12 width"].max() <= 20_000


def test_the_simulated_actuator_is_that_of_table_1(folder: Path) -> None:
    table = pd.read_csv(folder / "table-1.csv")
    np.testing.assert_allclose(table["simulated"], table["paper"], rtol=2e-3)


def test_friction_that_grows_with_the_load_is_beside_the_paper_s(folder: Path) -> None:
    """More friction under load than any normal training flight had looks like an emergency."""
    table = pd.read_csv(folder / "load-friction.csv")
    learned_without = table[table["trained at μ"] == 0.0]
    assert len(learned_without) == len(table) / 2 == 4
    assert (learned_without["normal called emergency at μ 0.3"] > 5.0).any()
    text = (folder / "report.md").read_text(encoding="utf-8")
    assert "## Friction that grows with the load" in text
    assert f"{TINY.networks} networks a row" in text


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    outcome = CliRunner().invoke(cli, ["study", "paper", "-o", str(tmp_path / "file"), "--quick"])
    assert "name a folder that you may write to" in str(outcome.exception)
