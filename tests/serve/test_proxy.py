"""The page behind a proxy with TLS, set up as examples/services/nginx.conf is."""

from __future__ import annotations

import contextlib
import re
import shutil
import ssl
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import httpx
import pytest

from mavhums.show.viewer import free_port
from tests.serve.browser import served

pytest.importorskip("plotly", reason="the page needs the extra 'serve'")

NGINX = shutil.which("nginx") or shutil.which("/usr/sbin/nginx")
OPENSSL = shutil.which("openssl")
RECIPE = Path(__file__).parents[2] / "examples" / "services" / "nginx.conf"
NAME = "hums.example.org"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(NGINX is None or OPENSSL is None, reason="no nginx, or no openssl"),
]


class Proxy(NamedTuple):
    """A client of the proxy that trusts its certificate and finds it by its name."""

    client: httpx.Client
    name: str
    token: str

    def ask(self, path: str, method: str = "GET", content: bytes = b"", **headers: str) -> httpx.Response:
        fields = {"host": self.name} | headers
        sent = self.client.build_request(method, path, content=content, headers=fields)
        sent.extensions["sni_hostname"] = NAME
        answer = self.client.send(sent)
        assert all("Secure" in cookie for cookie in answer.headers.get_list("set-cookie"))
        return answer


@pytest.fixture(scope="module")
def proxy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Proxy]:
    assert NGINX
    assert OPENSSL
    folder = tmp_path_factory.mktemp("proxy")
    key, certificate, port = folder / "key.pem", folder / "certificate.pem", free_port(0)
    subject = ("-subj", f"/CN={NAME}", "-addext", f"subjectAltName=DNS:{NAME}")
    made = (OPENSSL, "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", *subject)
    subprocess.run([*made, "-keyout", str(key), "-out", str(certificate)], check=True, capture_output=True)
    with served("--public-name", f"{NAME}:{port}") as page:
        inner, token = re.search(r"http://(127\S+)/", page.lines[1]), re.search(r"token=(\S+)", page.lines[0])
        assert inner
        assert token
        server = RECIPE.read_text(encoding="utf-8").replace("listen 443 ssl", f"listen 127.0.0.1:{port} ssl")
        server = server.replace(f"/etc/ssl/{NAME}.pem", str(certificate))
        server = server.replace(f"/etc/ssl/{NAME}.key", str(key)).replace("127.0.0.1:8080", inner[1])
        places = ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
        temporary = "".join(f"{place}_temp_path {folder}/{place};\n" for place in places)
        http = f"http {{\naccess_log off;\n{temporary}{server}}}\n"
        content = f"pid {folder}/pid;\ndaemon off;\nevents {{}}\n{http}"
        (folder / "nginx.conf").write_text(content)
        command = [NGINX, "-p", str(folder), "-e", str(folder / "errors"), "-c", str(folder / "nginx.conf")]
        program = subprocess.Popen(command)
        trusted = ssl.create_default_context(cafile=str(certificate))
        try:
            with httpx.Client(base_url=f"https://127.0.0.1:{port}", verify=trusted, timeout=60) as client:
                found = Proxy(client, f"{NAME}:{port}", token[1])
                wait_for(lambda: found.ask("/").status_code == 401)
                yield found
        finally:
            program.terminate()
            program.wait(timeout=30)


def wait_for(ready: Callable[[], bool]) -> None:
    end = time.monotonic() + 120
    while time.monotonic() < end:
        with contextlib.suppress(httpx.TransportError):
            if ready():
                return
        time.sleep(0.2)
    raise AssertionError("not in time")


def test_the_page_and_its_uploads_pass_the_proxy(proxy: Proxy, growing_log: Path) -> None:
    assert proxy.ask("/").status_code == 401, "a token is needed, though the page is on the loopback address"
    first = proxy.ask(f"/?token={proxy.token}")
    assert (first.status_code, first.headers["location"]) == (303, "/")
    page = proxy.ask("/")
    assert page.status_code == 200
    assert "Drop logs here" in page.text
    own = {"origin": f"https://{proxy.name}", "sec-fetch-site": "same-origin"}
    sent = proxy.ask("/logs?name=growing.tlog", "POST", growing_log.read_bytes(), **own)
    assert sent.status_code == 200, sent.text
    report = f"/logs/{sent.json()['id']}/report"
    wait_for(lambda: proxy.ask(report).status_code == 200)
    assert "EMERGENCY" in proxy.ask(report).text


def test_other_names_and_origins_are_refused_behind_it_as_well(proxy: Proxy) -> None:
    proxy.ask(f"/?token={proxy.token}")
    assert proxy.ask("/", origin="https://evil.example").status_code == 403
    assert proxy.ask("/", host="evil.example").status_code == 421
