"""The examples run, and show what they say."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from examples import demo, selectors_in_a_pipeline
from mavhums_sim.campaign import PAPER_FRICTION_NM


def test_the_demonstration_judges_every_actuator_right(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The paper's eight conditions and the growing one, from simulated flight to recording."""
    assert demo.main(tmp_path) == 0
    printed = capsys.readouterr().out
    assert "0 of 36 verdicts are wrong" in printed
    assert f"rerun {tmp_path}/flight.rrd" in printed
    assert len(list(tmp_path.glob("*.tlog"))) == 9
    assert (tmp_path / "flight.rrd").stat().st_size < 10_000_000
    truth = json.loads((tmp_path / "truth.json").read_text())["flights"]
    assessments = json.loads((tmp_path / "verdicts.json").read_text())["assessments"]
    assert len(truth) == len(assessments) == 9
    for friction, assessment in zip(PAPER_FRICTION_NM, assessments, strict=False):
        elevator = next(v for v in assessment["verdicts"] if v["actuator"] == "elevator")
        assert elevator["friction_nm"]["estimate"] == pytest.approx(friction, abs=0.005)
        assert elevator["friction_nm"]["low"] <= friction <= elevator["friction_nm"]["high"]
        vote = elevator["p_emergency"]
        assert vote < 0.1 if friction < 0.5 else vote > 0.9
    growing = next(v for v in assessments[-1]["verdicts"] if v["actuator"] == "elevator")
    # 0.225 N·m grows by 0.00775 N·m each second: 0.375 at 19.4 s and 0.875 at 83.9 s.
    starts = [e["start_s"] for e in growing["evidence"] if e["kind"] == "friction"]
    assert starts[1] == pytest.approx(19.4, abs=6.0)
    assert starts[2] == pytest.approx(83.9, abs=6.0)


def test_selectors_compose_with_the_models_of_scikit_learn() -> None:
    """Algorithm 1 keeps what tells the conditions apart, and networks beat a fixed polynomial."""
    results = selectors_in_a_pipeline.main(seconds=8.0)
    assert len(results) == 6
    assert results["Algorithm 1 → tanh networks"] > 0.9
    assert results["Algorithm 1 → tanh networks"] > results["chi-square, best 6 → tanh networks"]
