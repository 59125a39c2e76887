"""A digest reaches a mail server and a webhook; where it does not, that is said, and it is printed."""

from __future__ import annotations

import json
import socketserver
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import pytest

from mavhums.core.errors import ExitCode
from tests.conftest import Run
from tests.fleet.stores import write_store
from tests.flights import flown, verdict

pytest.importorskip("apprise", reason="the extra 'fleet' is not installed")


SECRET = "s3cret-token"


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("notify") / "store"
    write_store(folder, {"D-N": [flown(verdict(condition="emergency"), day=0, name="n-0")]})
    return folder


@contextmanager
def served(server: socketserver.TCPServer) -> Iterator[int]:
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        server.server_close()


class Webhook(BaseHTTPRequestHandler):
    """Keeps what is posted; the path is the status of its answer."""

    got: list[tuple[str | None, bytes]] = []

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.got.append((self.headers["Content-Type"], body))
        self.send_response(int(self.path.split("/")[1]))
        self.send_header("Location", "/elsewhere")
        self.end_headers()

    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()

    def log_message(self, *_: Any) -> None:
        pass


class Mailbox(socketserver.StreamRequestHandler):
    """As much of SMTP as a client needs."""

    got: list[str] = []

    def handle(self) -> None:
        self.wfile.write(b"220 stand-in\r\n")
        data: list[bytes] | None = None
        for line in self.rfile:
            if data is not None and line == b".\r\n":
                self.got.append(b"".join(data).decode())
                data = None
            elif data is not None:
                data.append(line)
                continue
            elif line[:4].upper() == b"DATA":
                data = []
            self.wfile.write(b"354 go on\r\n" if data is not None else b"250 well\r\n")
            if line[:4].upper() == b"QUIT":
                return


@pytest.fixture
def webhook() -> Iterator[str]:
    Webhook.got.clear()
    with served(HTTPServer(("127.0.0.1", 0), Webhook)) as port:
        yield f"http://127.0.0.1:{port}"


@pytest.mark.slow
def test_a_webhook_gets_the_contract_and_a_mailbox_the_text(run: Run, store: Path, webhook: str) -> None:
    Mailbox.got.clear()
    with served(socketserver.ThreadingTCPServer(("127.0.0.1", 0), Mailbox)) as port:
        mail = f"mailto://127.0.0.1:{port}?from=fleet@example.org&to=ops@example.org&mode=insecure"
        notify = ("--notify", mail, "--notify", f"{webhook}/200/{SECRET}")
        outcome = run("fleet", "digest", "--store", store, *notify)
    assert (outcome.code, outcome.err) == (ExitCode.OK, "")
    ((kind, body),) = Webhook.got
    assert kind == "application/json"
    content = json.loads(body)
    assert content["schema"] == "mavhums.digest/1"
    assert [one["kind"] for one in content["changes"]] == ["new"]
    (message,) = Mailbox.got
    assert "To: ops@example.org" in message
    assert "Subject: 1 new since" in message
    assert "D-N elevator: emergency since flight 1" in message.replace("=\r\n", "")


@pytest.mark.slow
def test_nothing_to_say_sends_nothing_unless_asked(
    run: Run, store: Path, webhook: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MAVHUMS_NOTIFY", f"{webhook}/200")
    later = (datetime.now(UTC) + timedelta(days=1)).isoformat()
    assert run("fleet", "digest", "--store", store, "--since", later).code == ExitCode.OK
    assert Webhook.got == []
    run("fleet", "digest", "--store", store, "--since", later, "--notify-always")
    assert len(Webhook.got) == 1


def test_what_is_not_reached_is_said_without_a_secret(
    run: Run, store: Path, webhook: str, tmp_path: Path
) -> None:
    urls = tmp_path / "urls.txt"
    urls.write_text(
        f"# who must know\nhttp://127.0.0.1:1/{SECRET}\n\n{webhook}/503/{SECRET}\n{webhook}/302/{SECRET}\n"
        f"mailto://user:{SECRET}@127.0.0.1:1?from=a@example.org&to=b@example.org&mode=insecure\n"
        f"jsons://user:{SECRET}@127.0.0.1:1/{SECRET}\n"
        f"{webhook.replace('http', 'json')}/302/{SECRET}\n"
    )
    outcome = run("fleet", "digest", "--store", store, "--fail-on-news", "--notify", f"@{urls}")
    assert outcome.code == ExitCode.NOT_SENT
    assert "D-N elevator" in outcome.out, "it is printed all the same"
    problems = [line for line in outcome.err.splitlines() if line.startswith("mavhums: ")]
    reasons = ("Connection refused", "503", "302", "refused", "refused", "302")
    for problem, reason in zip(problems, reasons, strict=True):
        assert "127.0.0.1" in problem
        assert reason in problem
    assert SECRET not in outcome.err


@pytest.mark.parametrize("wrong", ["carrier-pigeon", "pigeon://roof", "@nowhere.txt", "https://"])
def test_an_address_that_is_none_is_refused_before_any_work(run: Run, store: Path, wrong: str) -> None:
    outcome = run("fleet", "digest", "--store", store, "--notify", wrong)
    assert outcome.code == ExitCode.ERROR
    assert "--notify" in outcome.err
    assert outcome.out == ""
