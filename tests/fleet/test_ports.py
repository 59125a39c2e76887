"""A scan connects to a cluster with certificates on both sides only, and opens no port of its own."""

from __future__ import annotations

import pytest

from mavhums.core.errors import MavhumsError

pytest.importorskip("distributed", reason="the extra 'fleet' is not installed")
pytest.importorskip("cryptography", reason="the extra 'fleet' is not installed")

from mavhums.fleet.judging import connected


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "127.0.0.1:1", "tls://127.0.0.1:1"])
def test_a_scheduler_without_certificates_is_refused(address: str) -> None:
    with pytest.raises(MavhumsError, match="without TLS anybody could run code"), connected(address):
        pass
