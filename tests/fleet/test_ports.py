"""The ports of a scan answer nobody without its certificates, and unpickle nothing of theirs."""

from __future__ import annotations

import os
import socket
import ssl
from contextlib import ExitStack
from pathlib import Path

import psutil
import pytest

from mavhums.core.errors import MavhumsError

pytest.importorskip("distributed", reason="the extra 'fleet' is not installed")
pytest.importorskip("cryptography", reason="the extra 'fleet' is not installed")

from mavhums.fleet.scan import connected


def answers(place: str) -> list[bytes]:
    """Return what a port says to a client without a certificate: by Dask's protocol, by TLS, and by HTTP.

    A server of Dask speaks first, and unpickles what comes after.
    """
    host, port = place.split(":")
    said = []
    trusting = ssl.create_default_context()
    trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
    for context, first in ((None, b""), (trusting, b""), (None, b"GET /health HTTP/1.0\r\n\r\n")):
        try:
            with socket.create_connection((host, int(port)), timeout=2) as plain, ExitStack() as stack:
                connection = stack.enter_context(context.wrap_socket(plain)) if context else plain
                connection.sendall(first)
                said.append(connection.recv(1000))
        except OSError:
            said.append(b"")
    return said


def listening() -> set[str]:
    """Return the places at which this process or a process of its own listens."""
    this = psutil.Process()
    found = (one for each in (this, *this.children(recursive=True)) for one in each.net_connections("tcp"))
    return {f"{one.laddr.ip}:{one.laddr.port}" for one in found if one.status == psutil.CONN_LISTEN}


@pytest.mark.slow
def test_only_the_certificates_of_a_scan_open_its_ports() -> None:
    before = listening()
    with connected(1, None) as client:
        assert client.submit(os.getpid).result() != os.getpid(), "the scan itself is served"
        places = listening() - before
        assert all(place.startswith("127.0.0.1:") for place in places)
        assert places
        for place in places:
            plain, encrypted, http = answers(place)
            assert (plain, encrypted) == (b"", b"")
            assert b" 200 " not in http
        # Dask imports from this folder.
        (folder,) = client.run(lambda dask_worker: dask_worker.local_directory).values()
        assert any(above.stat().st_mode & 0o777 == 0o700 for above in Path(folder).parents)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "127.0.0.1:1", "tls://127.0.0.1:1"])
def test_a_scheduler_without_certificates_is_refused(address: str) -> None:
    with pytest.raises(MavhumsError, match="without TLS anybody could run code"), connected(1, address):
        pass
