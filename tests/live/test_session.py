"""What a session records, why it judges nothing, and of what it warns."""

from __future__ import annotations

from pathlib import Path

import pytest

from mavhums.engine.events import Notice
from mavhums.log.mavlink.stamping import Piece
from mavhums_sim.link import EPOCH_US
from tests.links import records
from tests.live.attacks import attitude
from tests.live.conftest import Rig

SECOND_US = 1_000_000


def test_time_never_goes_back_in_a_recording(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    for times in ((9, 5), (), (8, 10), (10,)):
        rig.session.take([Piece("vehicle", EPOCH_US + time_us, attitude(1, time_us)) for time_us in times])
    rig.end()
    recorded = [(at - EPOCH_US, frame[6]) for at, _, frame in records(rig.recorder.path.read_bytes())]
    assert recorded == [(5, 5), (9, 9), (9, 8), (10, 10), (10, 10)], "time, and component"


@pytest.mark.parametrize(
    ("data", "code"), [(b"", "nothing_received"), (b"noise" * 9, "no_frame"), (attitude(1, 1), None)]
)
def test_why_nothing_is_judged_is_said(data: bytes, code: str | None, tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.hear([Piece("vehicle", EPOCH_US, data)] * bool(data))
    codes = {verdict.reason_codes for verdict in rig.session.close().verdicts}
    assert (codes == {(code,)}) == (code is not None)


def test_two_senders_of_a_vehicle_are_warned_about_once_a_minute(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rig = Rig(tmp_path)
    for second in range(100):
        time_us = EPOCH_US + SECOND_US * second
        rig.hear([Piece(sender, time_us + k, attitude(1, 1)) for k, sender in enumerate("ab")])
    notices = [one for one in rig.shown.events if isinstance(one, Notice) and "more than one" in one.text]
    assert [(one.vehicle, round(one.time_s)) for one in notices] == [(1, 1), (1, 61)]
    assert caplog.text.count("more than one sender transmits as vehicle 1") == 2
    rig.session.close()


def test_an_error_ends_a_session_with_its_verdicts(tmp_path: Path) -> None:
    rig = Rig(tmp_path)

    def fail() -> bool:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rig.session.run(fail)
    assert len(rig.shown.closed) == 1
