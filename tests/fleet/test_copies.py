"""In a fleet's store, a flight that several logs record counts once."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest

from mavhums_sim import Flight, fly, write_dataflash, write_tlog
from mavhums_sim.link import Link
from tests.conftest import Run

distributed = pytest.importorskip("distributed")

from mavhums import fleet  # noqa: E402

FLIGHTS = 3


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three flights, each as two stations and the aircraft's card have it."""
    folder = tmp_path_factory.mktemp("copies")
    for day in range(FLIGHTS):
        flown = fly(Flight(day, 21.0, rate_hz=25.0, tiers=("instrumented",)))
        write_tlog(flown, folder / f"{day}-near.tlog", Link(day=float(day)))
        write_tlog(flown, folder / f"{day}-far.tlog", Link(day=float(day), loss=0.01, latency_s=0.3))
        carried = fly(Flight(day, 21.0, rate_hz=25.0, tiers=("csrv", "pwm")))
        write_dataflash(carried, folder / f"{day}.BIN", day=float(day))
    return folder


@pytest.mark.slow
def test_the_best_recording_counts_and_the_others_are_named(logs: Path, run: Run, tmp_path: Path) -> None:
    arriving = sorted(logs.iterdir())
    told = []
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
    ) as cluster:
        options = fleet.ScanOptions(scheduler=cluster.scheduler_address)
        for seed in (1, 2):
            random.Random(seed).shuffle(arriving)
            store = tmp_path / str(seed)
            for part in (arriving[:4], arriving[4:]):
                fleet.scan(part, store, options)
            assert fleet.scan(arriving, store, options) == (0, 0, 3 * FLIGHTS)
            [aircraft] = {one.aircraft or "" for one in fleet.worst(store)}
            told.append(
                [(log, verdict.model_dump_json()) for log, verdict in fleet.verdicts(store, aircraft)]
            )
            assert fleet.trend(store, aircraft).flights == FLIGHTS
    assert told[0] == told[1]
    counted = sorted({log for log, _ in told[0]})
    assert [Path(log).name[0] for log in counted] == ["0", "1", "2"]
    far = str(logs / "0-far.tlog")
    assert far not in counted
    status = fleet.status(store)
    assert status.judged == 3 * FLIGHTS
    assert len(status.copies) == 2 * FLIGHTS
    assert {one.log for one in status.copies} == {str(log) for log in arriving} - set(counted)
    shown = run("fleet", "status", "--store", store)
    assert f"{far}: is of the same flight as {counted[0]}, which counts" in shown.out
    answer = json.loads(run("fleet", "status", "--store", store, "--json").out)
    assert answer["copies"][0] == {"log": far, "counted": counted[0]}
