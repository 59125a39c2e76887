"""The page for programs: the JSON of the command line, in the page's limits, behind its token."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import jsonschema
import pytest

pytest.importorskip("plotly", reason="the page needs the extra 'serve'")

import httpx

from mavhums import analyse, fleet
from mavhums.results.assessment import Assessment, json_schema
from tests.serve.browser import Served, served

pytestmark = pytest.mark.slow

MB = 1_000_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the page has its temporary files."""
    return tmp_path_factory.mktemp("of-the-page")


@pytest.fixture(scope="module")
def page(store: Path, folder: Path) -> Iterator[Served]:
    """The page of a store for other computers: with a token, logs up to 5 MB, and one that judges."""
    options = ("--host", "0.0.0.0", "--max-mb", "5", "--workers", "1")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", str(folder))
        with served("--store", store, *options, lines=3) as page:
            assert "WARNING" in page.lines[1]
            yield page


@pytest.fixture(scope="module")
def client(page: Served) -> Iterator[httpx.Client]:
    address, token = page.url.split("/?token=")
    port = address.rsplit(":", 1)[1]
    bearer = {"authorization": f"Bearer {token}"}
    with httpx.Client(base_url=f"http://127.0.0.1:{port}/api", headers=bearer, timeout=120) as client:
        yield client


def test_a_log_goes_in_and_its_assessment_comes_out(
    client: httpx.Client, growing_log: Path, folder: Path
) -> None:
    answer = client.post("/logs", params={"name": "../growing.tlog"}, content=growing_log.read_bytes())
    assert answer.status_code == 200
    reply = answer.json()
    jsonschema.validate(reply, json_schema())
    assert reply["log"]["path"] == "growing.tlog"
    own = analyse(growing_log)
    assert Assessment.model_validate_json(answer.content).verdicts == tuple(
        verdict.model_copy(update={"own": ()}) for verdict in own.verdicts
    )
    (files,) = folder.glob("mavhums-page-*")
    assert list(files.iterdir()) == [], "nothing of it stays"
    assert "set-cookie" not in answer.headers


@pytest.mark.parametrize(
    ("content", "status", "problem"),
    [
        (b"", 422, "the file is empty"),
        (b"this is no log\n" * 99, 422, "notes.txt: "),
        (b"x" * (5 * MB + 1), 422, "larger than 5 MB, the limit of this page"),
    ],
)
def test_what_is_refused_says_why_and_what_to_do(
    client: httpx.Client, content: bytes, status: int, problem: str
) -> None:
    answer = client.post("/logs", params={"name": "notes.txt"}, content=content)
    assert answer.status_code == status
    reply = answer.json()
    assert reply["problem"].startswith(problem)
    assert reply["remedy"]
    assert "mavhums-page-" not in answer.text


def test_every_wrong_question_is_answered_with_problem_and_remedy(client: httpx.Client) -> None:
    asked = {
        client.post("/logs", files={"file": b"x"}): 415,
        client.get("/fleet/trend"): 422,
        client.get("/fleet/trend", params={"aircraft": "D-NONE"}): 404,
        client.get("/fleet/flight", params={"aircraft": "D-FAILS", "log": "0"}): 404,
        client.get("/fleet/worst", params={"most": "0"}): 422,
        client.get("/nothing"): 404,
        client.delete("/version"): 405,
        client.get("/version", headers={"authorization": "Bearer wrong"}): 401,
        client.get("/version", headers={"host": "evil.example"}): 421,
        client.post("/version", content=b"x" * 2 * MB): 413,
    }
    for answer, status in asked.items():
        assert answer.status_code == status, answer.text
        reply = answer.json()
        assert reply["problem"]
        assert reply["remedy"]
        assert set(reply) == {"problem", "remedy"}


def test_a_store_is_asked_as_on_the_command_line(client: httpx.Client, store: Path) -> None:
    def command(*arguments: str) -> object:
        done = subprocess.run(
            [sys.executable, "-m", "mavhums", "fleet", *arguments, "--json"], capture_output=True, check=False
        )
        return json.loads(done.stdout)

    assert client.get("/fleet/status").json() == command("status", "--store", str(store))
    assert client.get("/fleet/worst", params={"most": 3}).json() == command(
        "worst", "--store", str(store), "-n", "3"
    )
    trend = client.get("/fleet/trend", params={"aircraft": "D-GROWS"}).json()
    assert trend == json.loads(fleet.trend(store, "D-GROWS").to_json())
    flights = client.get("/fleet/flights", params={"aircraft": "D-FAILS"}).json()
    assert len(flights) == 9
    last = client.get("/fleet/flight", params={"aircraft": "D-FAILS", "log": flights[-1]["log"]["sha256"]})
    jsonschema.validate(last.json(), json_schema())
    assert last.json()["verdicts"] == flights[-1]["verdicts"]


def test_a_new_store_begins_with_the_first_log_that_is_kept(healthy_log: Path, tmp_path: Path) -> None:
    new = tmp_path / "new"
    with served("--store", new, "--workers", "1") as page, httpx.Client(timeout=120) as client:
        headers = {"origin": page.url}
        log = client.post(
            f"{page.url}/api/logs?name=a.tlog", content=healthy_log.read_bytes(), headers=headers
        )
        assert log.json()["verdicts"]
        status = client.get(f"{page.url}/api/fleet/status")
        assert "no store of flights" in status.json()["problem"]
        assert "no store of flights" in client.get(f"{page.url}/fleet").text
    assert not new.exists()


def test_openapi_describes_every_path(client: httpx.Client) -> None:
    said = client.get("/openapi.json").json()
    wanted = {f"/fleet/{name}" for name in ("status", "worst", "trend", "flights", "flight")}
    assert set(said["paths"]) == wanted | {"/logs", "/version"}
    assert said["servers"] == [{"url": "/api"}]
    assert "OwnRecord" not in said["components"]["schemas"]
    for path in said["paths"].values():
        (one,) = path.values()
        assert one["summary"]
        assert one["security"]
        assert one["responses"]["200"]["content"]["application/json"]["schema"]


def test_many_at_once_take_turns(client: httpx.Client, healthy_log: Path) -> None:
    answers: list[int] = []
    content = healthy_log.read_bytes()
    several = [
        threading.Thread(target=lambda: answers.append(client.post("/logs", content=content).status_code))
        for _ in range(6)
    ]
    for each in several:
        each.start()
    for each in several:
        each.join()
    assert answers == [200] * 6
