"""What a user gets wrong: one line, the right code, and every file as it was."""

from __future__ import annotations

import re
import shlex
import shutil
import socket
from pathlib import Path

import pytest

import mavhums
from mavhums.core.errors import ExitCode
from mavhums.live.links import Address, AddressError
from tests.conftest import Run

pytest.importorskip("plotly", reason="the page needs the extra 'serve'")
pytest.importorskip("rerun", reason="recordings need the extra 'viewer'")

PROFILE = Path(__file__).parents[2] / "examples" / "profiles" / "csrv.toml"
ERROR, USAGE = ExitCode.ERROR, ExitCode.USAGE
MODELS = f"name one of {', '.join(mavhums.models())}, or train one"


@pytest.mark.parametrize(
    ("command", "code", "text"),
    [
        ("analyse", USAGE, "Missing argument"),
        ("fly", USAGE, "No such command"),
        ("inspect {folder}/absent.tlog", ERROR, "no such file"),
        ("analyse {log} --markdown --json", USAGE, "leave out --json"),
        ("analyse {log} --open", USAGE, "--open needs --rrd"),
        ("analyse {log} {log} --rrd x", USAGE, "share one recording"),
        ("analyse {log} {other} --rrd {log}/x", ERROR, "--rrd names a folder"),
        ("analyse {log} --rrd {folder}/no/x.rrd", ERROR, "no/x.rrd: there is no folder {folder}/no"),
        ("analyse {profile}", ERROR, "an airframe profile, not a log\n  remedy: pass it with --airframe"),
        (
            "analyse {log} --airframe {log}",
            ERROR,
            "this is not an airframe profile but a binary file, as a log",
        ),
        ("report {log}", USAGE, "Missing option '-o'"),
        ("report {log} -o {log}", ERROR, "is the log itself"),
        ("report {folder}/absent.tlog -o {folder}/x.html", ERROR, "absent.tlog"),
        ("report {log} -o {folder}/no/x.html", ERROR, "cannot write"),
        ("export {folder}/absent.tlog -o {folder}/x.csv", ERROR, "no such file"),
        ("export {log} -o {folder}/x.xls", ERROR, "use the extension .parquet or .csv"),
        ("export {log} -o {folder}/x.csv --messages ATITUDE", ERROR, "did you mean ATTITUDE?"),
        ("export {log} -o {folder}/x.csv --messages ATTITUDE,XYZ", ERROR, "contains no message XYZ"),
        ("export {log} -o {folder}/x.csv --messages ' , '", ERROR, "no message is named"),
        ("export {log} -o {folder}/x.csv --messages X --airframe paper", USAGE, "--airframe is for"),
        ("export {log} -o {folder}/x.csv --messages X --classify", USAGE, "--classify is for"),
        ("export {log} -o {folder}/x.csv --messages X --curves", USAGE, "not --messages"),
        ("export {log} -o {folder}/x.csv --model paper-esc", USAGE, "--model is for --classify"),
        ("export {log} -o {folder}/x.csv --airframe nonesuch", ERROR, "no airframe profile 'nonesuch'"),
        ("export {log} -o {folder}/no/x.csv", ERROR, "cannot write"),
        ("export {log} -o {folder}/no/x.csv --messages ATTITUDE", ERROR, "cannot write"),
        ("serve --store {folder}/absent/store", ERROR, "no such folder\n  remedy: make it"),
        ("serve --host 192.0.2.1 --port 0", ERROR, "192.0.2.1"),
        ("model show {folder}/absent", ERROR, "no readable model file"),
        ("model show paper-ecs", ERROR, MODELS),
        ("analyse {log} --model paper-ecs", ERROR, MODELS),
        ("report {log} -o {folder}/x.html --model paper-ecs", ERROR, MODELS),
        ("live udpin:0 --model paper-ecs", ERROR, MODELS),
        ("fleet scan {log} --store {folder}/store --model paper-ecs", ERROR, MODELS),
        ("serve --port 0 --model paper-ecs", ERROR, MODELS),
    ],
)
def test_what_is_wrong_is_said_in_one_line_and_leaves_every_file_as_it_was(
    run: Run, short_log: Path, healthy_log: Path, tmp_path: Path, command: str, code: ExitCode, text: str
) -> None:
    log = Path(shutil.copy(short_log, tmp_path))
    places = {"log": log, "other": healthy_log, "folder": tmp_path, "profile": PROFILE}
    outcome = run(*shlex.split(command.format(**places)))
    assert outcome.code == code
    assert text.format(**places) in outcome.err
    assert not re.search(r"Traceback|\.part\b", outcome.err)
    assert [*tmp_path.iterdir()] == [log]
    assert log.read_bytes() == short_log.read_bytes()


def test_a_taken_port_is_reported(run: Run) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        code, _, err = run("serve", "--port", str(taken.getsockname()[1]))
    assert code == ERROR
    assert "Address already in use" in err
    assert "--port" in err


@pytest.mark.parametrize("url", ["udp:14550", "14550", ":14550", "udp:0.0.0.0:14550"])
def test_an_address_without_its_way_names_the_likely_one(url: str) -> None:
    meant = f"udpin:{url.removeprefix('udp').strip(':')}"
    with pytest.raises(AddressError) as error:
        Address.parse(url)
    assert error.value.remedy.startswith(f"did you mean {meant}? ")
    with pytest.raises(AddressError, match="it must be udpin"):
        Address.parse("nonsense")
