"""Damaged logs: one whose first bytes are damaged is recognised, and no command fails on any."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from benchmarks.damaged import default_logs, run
from mavhums.core.errors import ExitCode
from mavhums.log import Decoder
from mavhums.log.formats import MAVLINK, format_of
from mavhums_sim import Flight, fly, write_dataflash, write_tlog
from tests.conftest import Run
from tests.log.decode import decode
from tests.log.ulog import writer


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("beginning")
    flown = fly(Flight(seed=1, duration_s=4.0, rate_hz=20.0, tiers=("pwm",)))
    write_tlog(flown, folder / "a.tlog")
    write_dataflash(flown, folder / "a.BIN")
    return {
        "tlog": (folder / "a.tlog").read_bytes(),
        "dataflash": (folder / "a.BIN").read_bytes(),
        "ulog": writer.flight(4.0),
    }


def rows(data: bytes, block: int) -> tuple[str, dict[str, int]]:
    tables, decoder = decode(data, range(block, len(data), block))
    return decoder.format, {name: len(table) for name, table in tables.items()}


@pytest.mark.parametrize("name", ["tlog", "dataflash", "ulog"])
@pytest.mark.parametrize("size", [1, 2, 7, 16])
@pytest.mark.parametrize("how", ["zeros", "noise", "gone"])
def test_the_format_and_nearly_all_messages_are_found(
    logs: dict[str, bytes], name: str, size: int, how: str
) -> None:
    whole = rows(logs[name], 1 << 20)[1]
    start = {"zeros": bytes(size), "noise": random.Random(size).randbytes(size), "gone": b""}[how]
    data = start + logs[name][size:]
    found, counts = rows(data, 1 << 20)
    assert found == name
    assert rows(data, 777) == (found, counts)
    assert sum(counts.values()) >= sum(whole.values()) - 3


def test_damage_is_counted_and_the_log_is_judged(run: Run, logs: dict[str, bytes], tmp_path: Path) -> None:
    for name, suffix in (("dataflash", "BIN"), ("ulog", "ulg")):
        path = tmp_path / f"flight.{suffix}"
        path.write_bytes(bytes(16) + logs[name][16:])
        outcome = run("inspect", path)
        assert outcome.code == ExitCode.READ_WITH_LOSSES, outcome.err
        assert "servo" in outcome.out.lower()


def test_noise_has_no_format(run: Run, tmp_path: Path) -> None:
    noise = random.Random(5).randbytes(100_000)
    assert format_of(noise) is MAVLINK
    (tmp_path / "noise.BIN").write_bytes(noise)
    assert run("inspect", tmp_path / "noise.BIN").code == ExitCode.ERROR


def test_a_live_stream_does_not_wait(logs: dict[str, bytes]) -> None:
    decoder = Decoder()
    assert decoder.feed(logs["tlog"][:2000])


@pytest.mark.slow
def test_no_command_fails_on_a_damaged_log() -> None:
    assert run(default_logs(), count=8, seed=7) == {}
