"""One decoder for every format: the first bytes choose, however they are cut."""

from __future__ import annotations

import pytest

from mavhums.core.errors import MavhumsError
from mavhums.log import Decoder, LogDecoder
from mavhums.log.decoding import FORMATS, format_of


def test_a_log_without_a_signature_is_mavlink() -> None:
    decoder: LogDecoder = Decoder()
    decoder.feed(b"", final=False)
    decoder.feed(b"not a log", final=True)
    assert decoder.format == "tlog"


@pytest.mark.parametrize("known", FORMATS, ids=lambda known: known.name)
def test_dialect_and_key_are_for_mavlink_alone(known: object) -> None:
    assert isinstance(known, type(FORMATS[0]))
    decoder = Decoder(key=bytes(32))
    with pytest.raises(MavhumsError, match="leave --key out"):
        decoder.feed(known.signature + bytes(16))


@pytest.mark.parametrize("known", FORMATS, ids=lambda known: known.name)
def test_the_signature_is_enough(known: object) -> None:
    assert isinstance(known, type(FORMATS[0]))
    assert format_of(known.signature) is known
    assert format_of(known.signature[:-1]) is None
