"""A live session refuses the earlier flights of another aircraft, as ``analyse`` does."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

import mavhums
from mavhums.core.errors import ExitCode
from mavhums.flights.folder import keep_assessment
from mavhums.live.session import Session
from mavhums.live.setup import LiveOptions, prepare
from mavhums.log.mavlink.stamping import Piece
from tests.conftest import Run
from tests.flights import flown, identity, shown, verdict
from tests.live.conftest import Rig, Shown, verdicts
from tests.live.programs import free_port

SECOND_US = 1_000_000


def kept(folder: Path, *boards: str | None) -> Path:
    """Put an earlier flight of each board into a folder."""
    for day, board in enumerate(boards, -99):
        owned = identity(board=board, day=day)
        keep_assessment(flown(verdict(shown(0.2)), day=day, identities=[owned]), folder)
    return folder


@pytest.fixture(scope="module")
def board(worn_pieces: list[Piece], tmp_path_factory: pytest.TempPathFactory) -> str:
    """The board of the aircraft that flies."""
    rig = Rig(tmp_path_factory.mktemp("board"))
    rig.hear(worn_pieces)
    return str(rig.end().log.flight[0].board)


def session(tmp_path: Path, history: Path, table: Path | None = None) -> tuple[Session, Shown]:
    """A session as ``mavhums live`` prepares it."""
    sink, record = Shown(), tmp_path / "live.tlog"
    options = LiveOptions(
        urls=[f"udpin:{free_port()}"],
        record=record,
        judging=mavhums.Options(history=history, aircraft_table=table),
    )
    return prepare(options, [sink]), sink


def hear(follows: Session, sent: Sequence[Piece]) -> int:
    """Take pieces second by second, and return how many were taken when the session refused to go on."""
    begin = 0
    for end, piece in enumerate(sent, 1):
        if piece.time_us - sent[begin].time_us >= SECOND_US or end == len(sent):
            follows.take(list(sent[begin:end]))
            begin = end
            try:
                follows.tick()
            except mavhums.OtherAircraftError:
                return end
    return len(sent)


def test_the_board_of_another_aircraft_ends_the_session(worn_pieces: list[Piece], tmp_path: Path) -> None:
    follows, sink = session(tmp_path, history=kept(tmp_path / "flights", "0A"))
    assert hear(follows, worn_pieces) < len(worn_pieces) / 3
    with pytest.raises(mavhums.OtherAircraftError, match=r"but .*flights contains flights of .* board 0A"):
        follows.close()
    assert "contains flights of the aircraft with the board 0A" in sink.closed[0].log.notices[-1]
    recorded = mavhums.read_log(tmp_path / "live.tlog")
    assert recorded.counts
    assert not recorded.losses.any


@pytest.mark.slow
def test_its_own_flights_are_its_history(worn_pieces: list[Piece], board: str, tmp_path: Path) -> None:
    folder = kept(tmp_path / "flights", board)
    follows, _ = session(tmp_path, history=folder)
    assert hear(follows, worn_pieces) == len(worn_pieces)
    live = follows.close()
    replayed = mavhums.analyse(tmp_path / "live.tlog", mavhums.Options(history=folder))
    assert json.dumps(verdicts(live)) == json.dumps(verdicts(replayed))
    assert live.log.notices == replayed.log.notices


@pytest.mark.slow
def test_a_history_without_boards_is_accepted_with_a_notice(worn_pieces: list[Piece], tmp_path: Path) -> None:
    follows, _ = session(tmp_path, history=kept(tmp_path / "flights", None))
    assert hear(follows, worn_pieces) == len(worn_pieces)
    assert "reports no board id" in follows.close().log.notices[-1]


@pytest.mark.slow
def test_a_table_tells_of_a_swapped_board(worn_pieces: list[Piece], board: str, tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text(f"aircraft,board,actuator,serial,from,to\nD-A,0A,,,,\nD-A,{board},,,,\n")
    folder = kept(tmp_path / "flights", "0A")
    follows, _ = session(tmp_path, history=folder, table=table)
    assert hear(follows, worn_pieces) == len(worn_pieces)
    assert follows.close().log.flight[0].aircraft == "D-A"


def test_a_folder_of_two_aircraft_is_refused_before_the_start(run: Run, tmp_path: Path) -> None:
    folder = kept(tmp_path / "flights", "0A", "0B")
    refused = run("live", f"udpin:{free_port()}", "--history", folder, "--duration", "1")
    assert refused.code == ExitCode.ERROR
    assert f"{folder}: contains flights of the aircraft with the board 0A" in refused.err
