"""Every message of the dialects, in both protocol versions, against pymavlink's own classes."""

from __future__ import annotations

import importlib.util
import io
import struct
from contextlib import redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v10 import ardupilotmega as ardupilotmega_v1
from pymavlink.dialects.v10 import development as development_v1
from pymavlink.dialects.v20 import ardupilotmega, development
from pymavlink.generator import mavgen

import mavhums.log
from mavhums.log import Decoder, read_log
from mavhums.log.mavlink import dialect
from mavhums.log.mavlink.dialect import DialectError, load_dialect
from tests.log.decode import differing_fields
from tests.present import present
from tests.strategies import START_US, contents

OURS = sorted(Path(mavhums.log.__file__).parent.joinpath("messages").glob("*.xml"))
SHIPPED = {
    2: {**development.mavlink_map, **ardupilotmega.mavlink_map},
    1: {n: m for n, m in {**development_v1.mavlink_map, **ardupilotmega_v1.mavlink_map}.items() if n < 256},
}
CASES = [(version, number) for version, kinds in SHIPPED.items() for number in sorted(kinds)]


@cache
def generated(xml: Path, folder: Path) -> Any:
    """The module that pymavlink's generator makes of an XML file."""
    path = folder / f"{xml.stem}.py"
    with redirect_stdout(io.StringIO()):
        mavgen.mavgen(mavgen.Opts(str(path), "2.0", "Python3", validate=False), [str(xml)])
    spec = present(importlib.util.spec_from_file_location(xml.stem, path))
    module = importlib.util.module_from_spec(spec)
    present(spec.loader).exec_module(module)
    return module


def assert_decodes(message: Any, link: Any) -> None:
    decoder = Decoder()
    data = struct.pack(">Q", START_US) + bytes(message.pack(link))
    assert differing_fields(decoder.feed(data, final=True)[message.get_type()], [message]) == []
    assert not decoder.losses.any


@pytest.mark.parametrize(("version", "number"), CASES)
@given(data=st.data())
@settings(max_examples=3, deadline=None, suppress_health_check=list(HealthCheck), database=None)
def test_every_message_is_decoded_as_pymavlink_packed_it(
    version: int, number: int, data: st.DataObject
) -> None:
    kind = SHIPPED[version][number]
    dialect = ardupilotmega if version == 2 else ardupilotmega_v1
    assert_decodes(data.draw(contents(kind)), dialect.MAVLink(None, srcSystem=1, srcComponent=1))


def test_no_message_of_the_dialects_is_missing() -> None:
    definitions = load_dialect().definitions
    assert set(SHIPPED[2]) <= set(definitions)
    for number, kind in SHIPPED[2].items():
        definition = definitions[number]
        assert (definition.name, definition.crc_extra) == (kind.msgname, kind.crc_extra)
        assert definition.wire.itemsize == kind.unpacker.size
        assert list(definition.wire.names or ()) == kind.ordered_fieldnames


@pytest.mark.parametrize("xml", OURS, ids=lambda path: path.name)
@given(data=st.data())
@settings(max_examples=5, deadline=None, suppress_health_check=list(HealthCheck), database=None)
def test_messages_of_our_own_xml_are_as_pymavlinks_generator_makes_them(
    xml: Path, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    module = generated(xml, tmp_path_factory.getbasetemp())
    for kind in module.mavlink_map.values():
        assert_decodes(data.draw(contents(kind)), module.MAVLink(None, srcSystem=1, srcComponent=1))


def test_the_extension_fields_do_not_count_for_mavlink_1() -> None:
    assert load_dialect().definitions[36].base_size == 21


OWN = """<?xml version="1.0"?>
<mavlink><include>{include}</include><messages>
  <message id="{number}" name="WING_LOAD"><description/>
    <field type="float[2]" name="bending" units="N.m">Left, right.</field>
    <field type="uint8_t" name="side">Side.</field>
  </message>
</messages></mavlink>
"""


@pytest.mark.parametrize("number", [43_000, 16_000_000, 30])
def test_a_users_dialect_goes_before_the_shipped_ones(number: int, tmp_path: Path) -> None:
    xml, alone = tmp_path / "own.xml", tmp_path / "alone.xml"
    xml.write_text(OWN.format(number=number, include="minimal.xml"))
    alone.write_text(xml.read_text().replace("<include>minimal.xml</include>", ""))
    module = generated(alone, tmp_path)
    link = module.MAVLink(None, srcSystem=1, srcComponent=1)
    message = module.MAVLink_wing_load_message([1.5, -2.5], 7)
    log = tmp_path / "flight.tlog"
    log.write_bytes(struct.pack(">Q", START_US) + bytes(message.pack(link)))
    table = read_log(log, dialect=xml).tables["WING_LOAD"]
    assert table["bending"].tolist() == [[1.5, -2.5]]
    if number != 30:
        assert read_log(log).unknown == {number: 1}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (None, "No such file"),
        ("<mavlink>", "not MAVLink XML"),
        (OWN.format(number=1, include="n.xml"), "No such"),
    ],
)
def test_a_dialect_that_cannot_be_used_is_named(text: str | None, problem: str, tmp_path: Path) -> None:
    xml = tmp_path / "own.xml"
    if text is not None:
        xml.write_text(text)
    with pytest.raises(DialectError, match=problem) as caught:
        Decoder(dialect=xml)
    assert caught.value.remedy


def test_what_the_build_wrote_down_is_used_only_for_the_same_xml(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dialect, "BUILT", tmp_path / "dialect.json")
    parsed = load_dialect.__wrapped__().definitions
    dialect.write_definitions()
    with monkeypatch.context() as context:
        context.delattr(dialect, "shipped_definitions")
        assert load_dialect.__wrapped__().definitions == parsed
    whole = dialect.BUILT.read_bytes()
    dialect.BUILT.write_bytes(whole[:-100])  # a build that was interrupted
    assert load_dialect.__wrapped__().definitions == parsed
    dialect.BUILT.write_bytes(whole)
    with monkeypatch.context() as context:
        context.setattr(dialect, "OWN", tmp_path)  # without a message of ours: another set of XML
        fewer = load_dialect.__wrapped__().definitions
    assert parsed.keys() > fewer.keys()
