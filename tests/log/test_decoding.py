"""One decoder for every format: the first bytes choose, however they are cut."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import mavhums.log
from mavhums.core.errors import MavhumsError
from mavhums.log import Decoder, LogDecoder
from mavhums.log.formats import FORMATS, MAVLINK, Format, format_of


def test_a_log_without_a_signature_is_mavlink() -> None:
    decoder: LogDecoder = Decoder()
    decoder.feed(b"", final=False)
    decoder.feed(b"not a log", final=True)
    assert decoder.format == "tlog"


SIGNED = [known for known in FORMATS if known.signature]


@pytest.mark.parametrize("known", SIGNED, ids=lambda known: known.name)
def test_dialect_and_key_are_for_mavlink_alone(known: Format) -> None:
    decoder = Decoder(key=bytes(32))
    with pytest.raises(MavhumsError, match="leave --key out"):
        decoder.feed(known.signature + bytes(16))


@pytest.mark.parametrize("known", SIGNED, ids=lambda known: known.name)
def test_the_signature_is_enough(known: Format) -> None:
    assert format_of(known.signature) is known
    assert format_of(known.signature[:-1]) is MAVLINK


def test_the_list_of_formats_is_light_and_names_every_package() -> None:
    """A program that only recognises logs must not wait for numba."""
    there = {
        entry.name for entry in Path(mavhums.log.__file__).parent.iterdir() if (entry / "decoder.py").exists()
    }
    assert {known.package for known in FORMATS} == {f"mavhums.log.{name}" for name in there - {"base"}}
    code = "import sys, mavhums.log.formats; print(sorted({'numpy', 'numba', 'pydantic'} & {*sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
