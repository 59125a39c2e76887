"""One thing given in the place of another: the error names what it is, and what was meant."""

from __future__ import annotations

from pathlib import Path

import pytest

from mavhums.core.errors import ExitCode
from mavhums.live.links import Address, AddressError
from tests.conftest import Run

PROFILE = Path(__file__).parents[2] / "examples" / "profiles" / "csrv.toml"


@pytest.mark.parametrize(
    ("url", "meant"),
    [
        ("udp:14550", "udpin:14550"),
        ("14550", "udpin:14550"),
        (":14550", "udpin:14550"),
        ("udp:0.0.0.0:14550", "udpin:0.0.0.0:14550"),
    ],
)
def test_an_address_without_its_way_names_the_likely_one(url: str, meant: str) -> None:
    with pytest.raises(AddressError) as error:
        Address.parse(url)
    assert error.value.remedy.startswith(f"did you mean {meant}? ")
    with pytest.raises(AddressError, match="it must be udpin"):
        Address.parse("nonsense")


def test_a_log_is_no_profile_and_a_profile_is_no_log(run: Run, short_log: Path) -> None:
    given = run("analyse", PROFILE)
    assert given.code == ExitCode.ERROR
    assert "this is an airframe profile, not a log" in given.err
    assert "--airframe" in given.err
    given = run("analyse", short_log, "--airframe", short_log)
    assert given.code == ExitCode.ERROR
    assert "this is not an airframe profile but a binary file, as a log is" in given.err


def test_a_recording_in_no_folder_names_no_temporary_file(run: Run, short_log: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="recordings need the extra 'viewer'")
    path = tmp_path / "noexist" / "out.rrd"
    given = run("analyse", short_log, "--rrd", path)
    assert given.code == ExitCode.ERROR
    assert f"cannot write {path}: there is no folder {path.parent}" in given.err
    assert ".part" not in given.err
