"""A hostile link: memory, time and answers stay bounded, whoever speaks."""

from __future__ import annotations

import itertools
import random
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

import mavhums
from mavhums.engine.axes import MOST_VEHICLES
from mavhums.engine.engine import Engine
from mavhums.log.mavlink.stamping import Piece
from mavhums_sim.link import EPOCH_US
from tests.live.attacks import ATTACKS, attitude, endure, flown, heartbeat, named
from tests.live.conftest import Rig


@pytest.mark.slow
def test_a_stream_is_not_cut_by_senders_of_another_link(rig: Rig, worn_pieces: list[Piece]) -> None:
    """Half frames over a serial line, and between the halves a hundred datagrams, each of its own port."""
    spoofed = (
        Piece(("udp", k), 0, heartbeat(9, k % 256) if k % 2 else b"\xfd half") for k in itertools.count()
    )
    both: list[Piece] = []
    for piece in worn_pieces[:40]:
        half = len(piece.data) // 2
        for part in (piece.data[:half], piece.data[half:]):
            both.append(Piece(("serial", 1), piece.time_us, part))
            both += [next(spoofed)._replace(time_us=piece.time_us) for _ in range(100)]
    for k in range(0, len(both), 1000):
        rig.session.take(both[k : k + 1000])
    engine = rig.session._engine
    assert isinstance(engine, Engine)
    counts = engine._decoder.counts
    assert sum(count for (system, _, _), count in counts.items() if system == 1) == 40
    rig.session.close()


@pytest.mark.slow
def test_more_vehicles_than_can_be_judged(tmp_path: Path) -> None:
    """The first are judged, in the order of the log, live as in the recording, whatever the blocks."""
    order = list(range(1, 37))
    random.Random(1).shuffle(order)
    frames = [(EPOCH_US, named(system)) for system in order]
    frames += [
        (EPOCH_US + 200_000 * step + k, frame)
        for step in range(1, 8)
        for k, system in enumerate(order)
        for frame in flown(system, 200_000 * step)
    ]
    rig = Rig(tmp_path)
    rig.hear(Piece("swarm", time_us, data) for time_us, data in frames)
    live = rig.end()
    assert [v for v in live.verdicts if v.reason_codes == ("crowded_out",)]
    judged = {
        verdict.vehicle
        for verdict in live.verdicts
        if verdict.subject == "actuator" and verdict.actuator != "all"
    }
    assert judged == set(order[:MOST_VEHICLES])
    record = rig.recorder.path.read_bytes()
    for size in (10_000, 77_777):
        engine = Engine()
        for k in range(0, len(record), size):
            engine.feed(record[k : k + size])
        engine.finish()
        again = {v.vehicle for v in engine.assessment().verdicts if v.actuator != "all"}
        assert again == judged


def test_a_place_is_not_taken_by_who_says_nothing_of_actuators(tmp_path: Path) -> None:
    log = tmp_path / "flight.tlog"
    stamped = [
        (EPOCH_US + 1000 * k).to_bytes(8, "big") + frame
        for k, frame in enumerate([*(attitude(system, 1) for system in range(1, 100)), named(200)])
    ]
    stamped += [
        (EPOCH_US + 200_000 * k).to_bytes(8, "big") + frame
        for k in range(1, 10)
        for frame in flown(200, 200_000 * k)
    ]
    log.write_bytes(b"".join(stamped))
    names = Counter(v.actuator for v in mavhums.analyse(log).verdicts if v.vehicle == 200)
    assert set(names) == {"aileron_left", "aileron_right", "elevator", "rudder"}


HARDEST = (
    "the same, a profile given",
    "255 vehicles that name a profile",
    "40,000 source ports",
    "10 MB of noise",
    "nobody reads standard output",
    "ever new senders without end",
)


@pytest.mark.slow
@pytest.mark.parametrize("name", HARDEST)
def test_an_attack_costs_little(
    name: str, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """Bounds that hold on any computer, a quarter of each crowd; times depend on it and are only reported."""
    cost = endure(ATTACKS[name], tmp_path, every=4, quiet_s=2.0)
    for what in ("memory_mb", "cpu", "shutdown_s"):
        record_property(what, getattr(cost, what))
    print(f"{cost.memory_mb:.0f} MB, {cost.cpu:.1%} of a core after it, {cost.shutdown_s:.2f} s to end")
    assert cost.memory_mb < 512, "MemoryMax of examples/services/mavhums.service"
    assert cost.shutdown_s < 60.0, "it does not end"
    if not ATTACKS[name].lasts:
        assert cost.cpu < 0.5, "it does not come to rest"
    recording = tmp_path / "live.tlog"
    log = mavhums.read_log(recording) if recording.stat().st_size else None
    assert log is None or not log.losses.any
