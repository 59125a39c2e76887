"""Numbers of a damaged log: NaNs that signal, in every field of every message."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mavhums import Engine
from mavhums.actuator.profile import load_airframe
from mavhums.engine.options import EngineOptions
from mavhums.log.base.decoder import Table
from mavhums_sim import Flight, fly, write_tlog
from tests.conftest import carried_logs, real_logs

CSRV = Path(__file__).parents[2] / "examples" / "profiles" / "csrv.toml"
SIGNALS = {2: 0x7C01, 4: 0x7F800001, 8: 0x7FF0000000000001}  # by bytes


def damaged(table: Table, rng: np.random.Generator) -> Table:
    fields = table.fields.copy()
    for name in fields.dtype.names or ():
        numbers = np.ascontiguousarray(fields[name])
        if numbers.dtype.kind == "f":
            bits = numbers.view(f"u{numbers.dtype.itemsize}")
            bits[rng.random(bits.shape) < 0.03] = SIGNALS[numbers.dtype.itemsize]
            fields[name] = numbers
    return replace(table, fields=fields)


def judge(log: bytes, monkeypatch: pytest.MonkeyPatch, engine: Engine) -> None:
    rng = np.random.default_rng(1)
    decode = engine._decoder.feed

    def feed(block: bytes, *, final: bool = False) -> dict[str, Table]:
        tables = decode(block, final=final)
        with warnings.catch_warnings(action="ignore"):
            return {name: damaged(table, rng) for name, table in tables.items()}

    monkeypatch.setattr(engine._decoder, "feed", feed)
    for start in range(0, len(log), 1 << 20):
        engine.feed(log[start : start + (1 << 20)])
    engine.finish()
    engine.assessment().to_json()


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("path", [*carried_logs(), *real_logs("onboard")], ids=lambda path: path.name)
def test_no_damaged_number_warns(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    judge(path.read_bytes(), monkeypatch, Engine())


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_no_damaged_value_that_a_profile_maps_warns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    profile = CSRV.read_text(encoding="utf-8").replace("Cmd", "V01").replace("Pos", "V03")
    (tmp_path / "mine.toml").write_text(profile, encoding="utf-8")
    write_tlog(fly(Flight(seed=3, duration_s=12.0, tiers=("named",))), tmp_path / "named.tlog")
    engine = Engine(EngineOptions(load_airframe(tmp_path / "mine.toml")))
    judge((tmp_path / "named.tlog").read_bytes(), monkeypatch, engine)
