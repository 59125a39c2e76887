"""The compiled kernels: their types, their freshness, and numba as their oracle."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from mavhums.core import kernels
from mavhums.core.kernels import KERNELS, PACKAGE, digest, is_built, kinds_of
from mavhums.health.axis.residuals import _slewed
from mavhums_sim import Flight, fly, write_dataflash
from tests.log.ulog.writer import flight as ulog_flight

ANALYSE = "import sys, mavhums; sys.stdout.write(mavhums.analyse(sys.argv[1]).to_json())"
MISSING = "import sys; sys.modules['numba'] = None; import mavhums.core.kernels"

built = pytest.mark.skipif(not is_built(), reason="the kernels were not built from these sources")


def test_every_kernel_names_what_it_takes() -> None:
    for path in PACKAGE.rglob("*.py"):
        if "from mavhums.core.kernels import" in path.read_text(encoding="utf-8"):
            import_module(".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts))
    assert len(KERNELS) > 30
    assert all(kinds_of(function).parts for function in KERNELS.values())


@built
@pytest.mark.parametrize(
    "values", [np.zeros(3, np.float32), np.zeros((3, 2))[:, 0], np.zeros((1, 3)), [0.0]], ids=str
)
def test_another_array_is_refused(values: object) -> None:
    with pytest.raises(TypeError, match="_slewed takes"):
        _slewed(values, 1.0, 0.0)  # type: ignore[arg-type]


def test_a_changed_source_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "package"
    package.mkdir()
    source = package / "one.py"
    source.write_text("x = 1")
    monkeypatch.setattr(kernels, "PACKAGE", package)
    (package / kernels.SOURCES).write_text(f"{digest([source])}\none.py")
    assert is_built()
    source.write_text("x = 2")
    assert is_built(), "an installation has no sources that change"
    (tmp_path / "pyproject.toml").touch()
    assert not is_built()
    source.unlink()
    assert not is_built(), "nor without its sources"
    (package / kernels.SOURCES).unlink()
    assert not is_built()


def test_without_kernels_and_numba_the_remedy_is_named() -> None:
    environment = {**os.environ, "NUMBA_BOUNDSCHECK": "1"}
    command = [sys.executable, "-c", MISSING]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert "pip install --force-reinstall mavhums" in done.stderr.splitlines()[-1]


@pytest.mark.slow
@built
def test_numba_judges_alike(tmp_path: Path, growing_log: Path) -> None:
    """It compiles the same functions again, and checks every access of an array."""
    on_board, px4 = tmp_path / "on_board.BIN", tmp_path / "px4.ulg"
    write_dataflash(fly(Flight(seed=4, duration_s=20.0, rate_hz=20.0, tiers=("csrv", "pwm"))), on_board)
    px4.write_bytes(ulog_flight(30.0))
    checked = {**os.environ, "NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path / "numba")}
    for log in (growing_log, on_board, px4):
        command = [sys.executable, "-c", ANALYSE, str(log)]
        compiled, other = (
            subprocess.run(command, env=environment, capture_output=True, check=True).stdout
            for environment in (dict(os.environ), checked)
        )
        assert compiled == other
