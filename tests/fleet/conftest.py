"""An object store and a scheduler on this computer."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from urllib.error import URLError
from urllib.request import Request, urlopen

import pytest

from mavhums.fleet import sources


@pytest.fixture(scope="module")
def bucket() -> Iterator[str]:
    """The address of a bucket in moto's stand-in for S3."""
    pytest.importorskip("moto")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    address = f"http://127.0.0.1:{port}"
    with pytest.MonkeyPatch.context() as environment:
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
            environment.setenv(name, "x")
        environment.setenv("AWS_REGION", "us-east-1")
        environment.setenv("AWS_ENDPOINT_URL", address)
        environment.setenv("AWS_ALLOW_HTTP", "true")
        try:
            while server.poll() is None:
                try:
                    urlopen(Request(f"{address}/fleet", method="PUT"), timeout=60).close()
                    break
                except URLError:
                    time.sleep(0.1)
            sources._filesystem.cache_clear()
            yield "s3://fleet"
        finally:
            sources._filesystem.cache_clear()
            server.kill()
            server.wait()


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """A cluster in this process, which starts at once."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
    ) as cluster:
        yield cluster.scheduler_address
