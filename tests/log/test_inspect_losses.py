"""What ``mavhums inspect`` says of a damaged log, in words, in JSON and by its exit code."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from mavhums.app.inspection import inspect_log
from mavhums.cli.main import cli
from mavhums.core.errors import ExitCode, UnreadableLogError
from mavhums.show.inspection import inspection_blocks
from mavhums.show.terminal import plain
from tests.log.decode import frames_in
from tests.log.mavlink.test_frames import heartbeats, trimmed_after_crc
from tests.strategies import START_US


def said(path: Path) -> str:
    return plain(inspection_blocks(inspect_log(path)))


@pytest.fixture
def damaged(tmp_path: Path) -> Path:
    times = [START_US + 1000 * k for k in range(60)]
    beats = [bytearray(heartbeats([time])) for time in times]
    beats[10][20] ^= 1
    beats[20][1] ^= 0x80
    path = tmp_path / "damaged.tlog"
    begin: list[bytes | bytearray] = [*beats[:30], trimmed_after_crc(6), beats[30], b"noise"]
    path.write_bytes(b"".join([*begin, *beats[31:], beats[0][:7], bytes(40)]))
    return path


def test_every_loss_is_said_in_words(damaged: Path) -> None:
    text = said(damaged)
    assert "34 bytes skipped, 2 damaged regions, 1 frame with a wrong checksum, 1 implausible time" in text
    assert "wrong checksums: HEARTBEAT 1" in text
    assert "skipped at byte (offset+size): 290+29, 925+5" in text
    assert "7 bytes of a frame cut off at the end" in text
    assert "40 zero bytes follow the last frame" in text
    assert "Sequence numbers of 1/1" in text


def test_every_loss_is_in_the_json_and_in_the_exit_code(damaged: Path) -> None:
    result = CliRunner().invoke(cli, ["inspect", str(damaged), "--json"])
    assert result.exit_code == ExitCode.READ_WITH_LOSSES
    losses = json.loads(result.output)["assessment"]["log"]["losses"]
    assert losses["regions"] == [{"offset": 290, "size": 29}, {"offset": 925, "size": 5}]
    assert losses["bad_crc_by_message"] == {"HEARTBEAT": 1}
    assert losses["trailing_zeros"] == 40


BEAT = heartbeats([START_US])
JUMP = heartbeats([START_US, START_US + 1, START_US + 10**9, START_US + 10**9 + 1])
POWER = heartbeats([START_US + 1000 * k for k in range(40)])[:-9]


@pytest.mark.parametrize(
    ("log", "words", "code"),
    [
        (BEAT + trimmed_after_crc(6) + BEAT, "In doubt: 1 frames", ExitCode.READ_WITH_LOSSES),
        (JUMP, "jumps ahead 1 times", None),
        (
            POWER,
            "20 bytes of a frame cut off at the end",
            ExitCode.OK,
        ),  # it ends with the power, and lost none
    ],
    ids=["in doubt", "jump", "power"],
)
def test_what_is_no_loss_or_in_doubt_is_said(
    tmp_path: Path, log: bytes, words: str, code: int | None
) -> None:
    path = tmp_path / "some.tlog"
    path.write_bytes(log)
    assert words in said(path)
    assert code in (None, CliRunner().invoke(cli, ["inspect", str(path)]).exit_code)


def test_a_log_without_stamps_and_a_converted_one_are_named(tmp_path: Path) -> None:
    times = [START_US + 1000 * k for k in range(400)]
    data = heartbeats(times)
    text, raw = tmp_path / "text.tlog", tmp_path / "flight.tlog.raw"
    text.write_bytes(data.replace(b"\n", b"\r\n"))
    raw.write_bytes(b"".join(frames_in(data)))
    assert "converted to text (LF to CRLF)" in said(text)
    assert "Log losses: none" in said(text)
    assert "Dated by the time of its file: the log has no date" in said(raw)


def test_zeros_before_the_first_frame_are_passed_over_and_reported(tmp_path: Path) -> None:
    """A recorder that allots its file in advance: more zeros than are looked at for the format."""
    path, zeros = tmp_path / "zeros.tlog", 2_900_007
    path.write_bytes(bytes(zeros) + heartbeats([START_US + 1000 * k for k in range(40)]))
    inspection = inspect_log(path)
    assert inspection.messages[0].count == 40
    assert inspection.assessment.log.losses.bytes_skipped == zeros
    nothing = tmp_path / "nothing.tlog"
    nothing.write_bytes(bytes(zeros))
    with pytest.raises(UnreadableLogError, match="contains only zeros"):
        inspect_log(nothing)
