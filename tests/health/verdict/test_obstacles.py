"""Every requirement that a flight's axis does not meet is named, the binding one first, as it can be met."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.engine.test_axes import flown, judged, of
from tests.engine.wired import PX4_PLANE, Wired


def thinned(content: bytes, *, keep: int) -> bytes:
    """Keep each n-th of outputs, attitude and gyro."""
    out, seen, at = bytearray(), dict[int, int](), 0
    while at < len(content):
        size, number = 8 + content[at + 9] + 12, content[at + 8 + 7]
        seen[number] = seen.get(number, 0) + 1
        if number not in (36, 30, 27) or seen[number] % keep == 0:
            out += content[at : at + size]
        at += size
    return bytes(out)


@pytest.mark.parametrize(
    ("kind", "parameter"), [("tlog", "SRx_RC_CHAN"), ("dataflash", "LOG_BITMASK"), ("ulog", "SDLOG_PROFILE")]
)
def test_the_remedy_names_the_parameter_of_the_log_s_own_autopilot(kind: str, parameter: str) -> None:
    flight = Wired(seconds=60)
    flight = replace(flight, parameters=PX4_PLANE) if kind == "ulog" else flight
    pitch = of(judged(getattr(Slow(**flight.__dict__), kind)())[0], "pitch")
    assert pitch.reason_codes[0] == "stream_too_slow"
    assert parameter in str(pitch.remedy)


class Slow(Wired):
    """The same flight at 2 Hz."""

    def rows(self):  # type: ignore[no-untyped-def]
        for k, row in enumerate(super().rows()):
            if k % 5 == 0:
                yield row


def test_no_share_is_quoted_where_no_fit_was_made() -> None:
    """A surface that never moves: nothing was fitted, so that nothing is explained "to 0 %"."""
    assert "no_reference" in of(judged(flown(left=1.0))[0], "yaw").reason_codes
