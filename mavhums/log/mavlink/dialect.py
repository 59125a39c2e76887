"""MAVLink message definitions as numpy record types, from the dialects' XML.

The shipped set consists of pymavlink's ardupilotmega, with all its includes, and development, and of
``messages/*.xml`` beside this module for messages that these lack. A user's XML takes precedence.
To parse the shipped XML takes longer than to decode a short log: the build of the package writes down what it
defines, and this is used as long as the XML is the same.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from mavhums.core.errors import MavhumsError
from mavhums.core.kernels import PACKAGE, digest
from mavhums.log.base.decoder import C_NUMBERS

_SHIPPED = ("ardupilotmega.xml", "development.xml")
OWN = Path(__file__).with_name("messages")
BUILT = PACKAGE / "_dialect.json"
# What mavparse raises of a file that is no MAVLink XML, beside its own error.
_NOT_MAVLINK = (ElementTree.ParseError, LookupError, ValueError, AttributeError, TypeError)


class DialectError(MavhumsError):
    """The XML of a dialect cannot be used."""


@dataclass(frozen=True, slots=True)
class MessageDefinition:
    """One message of the dialect.

    Attributes
    ----------
    wire
        Record type of the full payload, fields in wire order; its size is the largest payload.
    base_size
        Size in bytes without the extension fields: the payload of MAVLink 1.
    crc_extra
        Seed by which sender and receiver agree on the definition.
    """

    id: int
    name: str
    crc_extra: int
    wire: np.dtype[np.void]
    base_size: int


@dataclass(frozen=True, slots=True, eq=False)
class Dialect:
    """Definitions by message id, ascending."""

    definitions: dict[int, MessageDefinition]


@cache
def load_dialect(path: Path | None = None) -> Dialect:
    """Return the shipped definitions, overridden by those of a user's MAVLink XML.

    If two shipped dialects define the same id, the larger definition is kept; a user's always wins.

    Parameters
    ----------
    path
        A MAVLink XML file; its includes are searched beside it, then among the shipped ones.

    Raises
    ------
    DialectError
        If the file is missing or is not MAVLink XML.
    """
    definitions = _built() or shipped_definitions()
    if path is not None:
        for document in reversed(list(_documents(path, set()))):
            definitions |= {message.id: _definition(message) for message in document.message}
    return Dialect(dict(sorted(definitions.items())))


def shipped_definitions() -> dict[int, MessageDefinition]:
    """Return the definitions of the shipped XML."""
    definitions: dict[int, MessageDefinition] = {}
    for document in _shipped():
        for definition in map(_definition, document.message):
            known = definitions.get(definition.id)
            # The larger of two has the newer extension fields; a shorter payload is filled with zeros.
            if known is None or definition.wire.itemsize > known.wire.itemsize:
                definitions[definition.id] = definition
    return definitions


def write_definitions() -> None:
    """Write the shipped definitions into the package, with the digest of their XML."""
    rows = [
        (one.id, one.name, one.crc_extra, one.base_size, one.wire.descr)
        for one in shipped_definitions().values()
    ]
    BUILT.write_text(json.dumps({"xml": _digest(), "messages": rows}), encoding="utf-8")


def _built() -> dict[int, MessageDefinition]:
    """Return what the build wrote down; nothing where it is not of this XML."""
    try:
        known = json.loads(BUILT.read_bytes())
    except (OSError, ValueError):  # not built, or not to its end
        return {}
    if known["xml"] != _digest():
        return {}
    return {
        number: MessageDefinition(number, name, crc_extra, np.dtype([*map(tuple, columns)]), base_size)
        for number, name, crc_extra, base_size, columns in known["messages"]
    }


def _digest() -> str:
    return digest([*sorted(_pymavlink_folder().glob("*.xml")), *sorted(OWN.glob("*.xml"))])


def _shipped() -> Iterator[Any]:
    seen: set[Path] = set()
    for name in _SHIPPED:
        yield from _documents(_pymavlink_folder() / name, seen)
    for path in sorted(OWN.glob("*.xml")):
        yield from _documents(path, seen)


def _pymavlink_folder() -> Path:
    import pymavlink

    return Path(pymavlink.__file__).parent / "dialects" / "v20"


def _documents(path: Path, seen: set[Path]) -> Iterator[Any]:
    """Yield a parsed XML file, then its includes, each once."""
    if path in seen:
        return
    seen.add(path)
    document = _parse(path)
    yield document
    for name in document.include:
        beside = path.parent / name
        yield from _documents(beside if beside.exists() else _pymavlink_folder() / name, seen)


def _parse(path: Path) -> Any:
    from pymavlink.generator import mavparse

    try:
        # mavparse lets expat's own error through, which is not ElementTree's.
        if _pymavlink_folder() not in path.parents:
            with path.open("rb") as file:
                ElementTree.parse(file)
        with redirect_stdout(io.StringIO()):
            return mavparse.MAVXML(str(path), mavparse.PROTOCOL_2_0)
    except OSError as error:
        raise DialectError(f"{path}: {error.strerror}", "check the path of the MAVLink XML") from error
    except (mavparse.MAVParseError, *_NOT_MAVLINK) as error:
        raise DialectError(f"{path}: not MAVLink XML ({error})", "check it with mavgen --validate") from error


def _definition(message: Any) -> MessageDefinition:
    wire = np.dtype([_column(field) for field in message.ordered_fields])
    return MessageDefinition(message.id, message.name, message.crc_extra, wire, message.wire_min_length)


def _column(field: Any) -> tuple[Any, ...]:
    if field.type == "char":
        return field.name, f"S{max(field.array_length, 1)}"
    if field.array_length:
        return field.name, C_NUMBERS[field.type], (field.array_length,)
    return field.name, C_NUMBERS[field.type]
