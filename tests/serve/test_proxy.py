"""The page behind a proxy with TLS, set up as examples/services/nginx.conf is."""

from __future__ import annotations

import json
import re
import shutil
import socket
import ssl
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing
from http.client import HTTPSConnection
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.serve.browser import Served, served

pytest.importorskip("plotly", reason="the page needs the extra 'serve'")

NGINX = shutil.which("nginx") or shutil.which("/usr/sbin/nginx")
OPENSSL = shutil.which("openssl")
RECIPE = Path(__file__).parents[2] / "examples" / "services" / "nginx.conf"
NAME = "hums.example.org"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(NGINX is None or OPENSSL is None, reason="no nginx, or no openssl"),
]


class Answer(NamedTuple):
    status: int
    headers: dict[str, str]
    body: bytes


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


class Proxy:
    """A client of the proxy that trusts its certificate and finds it by its name."""

    def __init__(self, port: int, certificate: Path, token: str) -> None:
        self.port, self.token = port, token
        self.name = f"{NAME}:{port}"
        self.context = ssl.create_default_context(cafile=str(certificate))
        self.cookies: dict[str, str] = {}

    def raw(self) -> ssl.SSLSocket:
        plain = socket.create_connection(("127.0.0.1", self.port), timeout=60)
        return self.context.wrap_socket(plain, server_hostname=NAME)

    def ask(self, path: str, method: str = "GET", body: bytes = b"", **headers: str) -> Answer:
        with closing(HTTPSConnection(NAME, self.port, timeout=60)) as link:
            link.sock = self.raw()
            cookie = "; ".join(f"{name}={value}" for name, value in self.cookies.items())
            link.request(method, path, body or None, {"Host": self.name, "Cookie": cookie, **headers})
            answer = link.getresponse()
            found = {name.lower(): value for name, value in answer.getheaders()}
            for name, value in answer.getheaders():
                if name.lower() == "set-cookie":
                    assert "Secure" in value
                    cookie, _, content = value.split(";")[0].partition("=")
                    self.cookies[cookie] = content
            return Answer(answer.status, found, answer.read())


@pytest.fixture(scope="module")
def proxy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Proxy]:
    assert NGINX
    assert OPENSSL
    folder = tmp_path_factory.mktemp("proxy")
    key, certificate, port = folder / "key.pem", folder / "certificate.pem", free_port()
    subject = ("-subj", f"/CN={NAME}", "-addext", f"subjectAltName=DNS:{NAME}")
    made = (OPENSSL, "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", *subject)
    subprocess.run([*made, "-keyout", str(key), "-out", str(certificate)], check=True, capture_output=True)
    with served("--public-name", f"{NAME}:{port}") as page:
        behind = re.search(r"http://(127\.0\.0\.1:\d+)", page.told[1])
        assert behind
        server = RECIPE.read_text(encoding="utf-8").replace("listen 443 ssl", f"listen 127.0.0.1:{port} ssl")
        server = server.replace(f"/etc/ssl/{NAME}.pem", str(certificate))
        server = server.replace(f"/etc/ssl/{NAME}.key", str(key)).replace("127.0.0.1:8080", behind[1])
        places = ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
        temporary = "".join(f"{place}_temp_path {folder}/{place};\n" for place in places)
        content = (
            f"pid {folder}/pid;\ndaemon off;\nevents {{}}\nhttp {{\naccess_log off;\n{temporary}{server}}}\n"
        )
        (folder / "nginx.conf").write_text(content)
        command = [NGINX, "-p", str(folder), "-e", str(folder / "errors"), "-c", str(folder / "nginx.conf")]
        program = subprocess.Popen(command)
        try:
            yield _when_ready(Proxy(port, certificate, _token(page)), folder)
        finally:
            program.terminate()
            program.wait(timeout=30)


def _token(page: Served) -> str:
    found = re.search(r"token=(\S+)", page.told[0])
    assert found
    return found[1]


def _when_ready(proxy: Proxy, folder: Path) -> Proxy:
    end = time.monotonic() + 60
    while time.monotonic() < end:
        try:
            if proxy.ask("/").status == 401:
                return proxy
        except OSError:
            pass
        time.sleep(0.2)
    raise AssertionError((folder / "errors").read_text())


def test_the_page_and_its_uploads_pass_the_proxy(proxy: Proxy, growing_log: Path) -> None:
    assert proxy.ask("/").status == 401, "a token is needed, though mavhums listens on the loopback address"
    first = proxy.ask(f"/?token={proxy.token}")
    assert (first.status, first.headers["location"]) == (303, "/")
    page = proxy.ask("/")
    assert page.status == 200
    assert b"Drop logs here" in page.body
    own = {"Origin": f"https://{proxy.name}", "Sec-Fetch-Site": "same-origin"}
    sent = proxy.ask("/logs?name=growing.tlog", "POST", growing_log.read_bytes(), **own)
    assert sent.status == 200, sent.body
    report = f"/logs/{json.loads(sent.body)['id']}/report"
    end = time.monotonic() + 120
    while proxy.ask(report).status != 200:
        assert time.monotonic() < end
        time.sleep(0.5)
    assert b"EMERGENCY" in proxy.ask(report).body


def test_other_names_and_origins_are_refused_behind_it_as_well(proxy: Proxy) -> None:
    proxy.ask(f"/?token={proxy.token}")
    assert proxy.ask("/", Origin="https://evil.example").status == 403
    own, proxy.name = proxy.name, "evil.example"
    try:
        assert proxy.ask("/").status == 421
    finally:
        proxy.name = own
