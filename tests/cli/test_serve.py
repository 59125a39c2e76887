"""The command ``serve``: what it refuses before it serves."""

from __future__ import annotations

import socket
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from mavhums.core.errors import ExitCode

if TYPE_CHECKING:
    from tests.conftest import Run


def test_a_store_that_is_none_is_refused(run: Run, tmp_path: Path) -> None:
    code, _, err = run("serve", "--store", tmp_path / "absent" / "store")
    assert code == ExitCode.ERROR
    assert "no such folder" in err
    assert "make it" in err


def test_a_taken_port_is_told(run: Run) -> None:
    pytest.importorskip("plotly")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        code, _, err = run("serve", "--port", str(taken.getsockname()[1]))
    assert code == ExitCode.ERROR
    assert "Address already in use" in err
    assert "--port" in err


def test_an_address_of_another_computer_is_told(run: Run) -> None:
    pytest.importorskip("plotly")
    code, _, err = run("serve", "--host", "192.0.2.1", "--port", "0")
    assert code == ExitCode.ERROR
    assert "192.0.2.1" in err
