"""The tables of a store, which Grafana, Metabase and Excel may read: times are microseconds since 1970, UTC.

``aircraft``, ``alias`` (its former names), ``board`` (what is installed in it, with dates), ``repair``,
``flight`` (the bytes of one log, judged), ``log`` (a file, with its flight or why there is none),
``recording`` (a vehicle's flight in a log), ``verdict`` and ``indicator`` (after the comparison with earlier
flights), ``record`` (the whole verdict, and what later comparisons need of it), ``judgement`` (the flight
before any), ``standing`` (the state of an aircraft after each change), ``journal`` (corrections) and
``setting``.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any, Final

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    ColumnElement,
    Float,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    Table,
    Text,
    false,
    true,
)
from sqlalchemy.dialects import postgresql

METADATA: Final = MetaData()

# The same order of texts in both databases.
_TEXT: Final = Text().with_variant(postgresql.TEXT(collation="C"), "postgresql")
_ID: Final = BigInteger().with_variant(Integer, "sqlite")


_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


def us_of(moment: datetime) -> int:
    """Return a time as the tables have it."""
    return (moment - _EPOCH) // timedelta(microseconds=1)


def time_of(us: int) -> datetime:
    """Return the time that the tables have."""
    return _EPOCH + timedelta(microseconds=us)


def _text(name: str, **given: Any) -> Column[Any]:
    return Column(name, _TEXT, **given)


def _whole(name: str, **given: Any) -> Column[Any]:
    return Column(name, BigInteger, **given)


def _numbers(*names: str) -> list[Column[Any]]:
    return [Column(name, Float(53)) for name in names]


def _flag(name: str) -> Column[Any]:
    return Column(name, Boolean, nullable=False, server_default=false())


def _id() -> Column[Any]:
    return Column("id", _ID, primary_key=True)


def _of(table: str, *, key: bool = False, **given: Any) -> Column[Any]:
    parent = ForeignKey(f"{table}.id", ondelete="CASCADE")
    return Column(f"{table}_id", BigInteger, parent, primary_key=key, **given)


def _index_few(name: str, where: ColumnElement[bool], *columns: Column[Any]) -> None:
    """Index the few rows that a query asks for, in the words that SQLAlchemy puts into the query."""
    Index(name, *columns, sqlite_where=where, postgresql_where=where)


AIRCRAFT: Final = Table("aircraft", METADATA, _id(), _text("name", unique=True, nullable=False))
ALIAS: Final = Table("alias", METADATA, _text("name", primary_key=True), _of("aircraft", nullable=False))
BOARD: Final = Table(
    "board",
    METADATA,
    _id(),
    _of("aircraft", nullable=False, index=True),
    *map(_text, ("board", "actuator", "serial", "begins", "ends")),
)
"""The operator's table: a board, or an actuator with its serial number, and from when to when."""

FLIGHT: Final = Table(
    "flight",
    METADATA,
    _id(),
    _text("sha256", unique=True, nullable=False),
    _of("aircraft"),
    *map(_text, ("path", "board", "airframe")),
    _whole("start_us"),
    *_numbers("duration_s"),
    _flag("losses"),
    _whole("came_us", nullable=False),
    Column("format", Integer, nullable=False),
    *map(_flag, ("due", "reference", "pinned")),
    Index("flight_by_time", "aircraft_id", "start_us", "path"),
    Index("flight_by_board", "board", "start_us"),
    Index("flight_boards", "aircraft_id", "board"),
    Index("flight_came", "came_us"),
)
"""``aircraft_id`` is NULL of a removed flight; verdicts of one that is ``due`` are not made yet; a baseline
may rest on a ``reference``; the operator gave a ``pinned`` one to its aircraft."""
for _name in ("due", "reference"):
    _index_few(f"flight_{_name}", FLIGHT.c[_name] == true(), FLIGHT.c.aircraft_id, FLIGHT.c.start_us)

JUDGEMENT: Final = Table(
    "judgement", METADATA, _of("flight", key=True), Column("alone", LargeBinary, nullable=False)
)
"""The flight before any comparison, packed."""

LOG: Final = Table(
    "log",
    METADATA,
    _id(),
    _text("path", nullable=False),
    _whole("size", nullable=False),
    _whole("time_ns", nullable=False),
    _text("settings", nullable=False),
    _of("flight", index=True),
    *map(_text, ("problem", "remedy")),
    _whole("scanned_us", nullable=False),
    _flag("removed"),
    Index("log_file", "path", "size", "time_ns", unique=True),
)
_index_few("log_removed", LOG.c.removed == true(), LOG.c.path)
_index_few("log_failed", LOG.c.problem.is_not(None), LOG.c.path)
RECORDING: Final = Table(
    "recording",
    METADATA,
    _of("flight", key=True),
    Column("vehicle", Integer, primary_key=True),
    _text("board"),
    _whole("boot_us"),
    *map(_text, ("identity", "quality")),
    Column("counted_id", BigInteger, ForeignKey("flight.id", ondelete="SET NULL")),
    Index("recording_by_boot", "board", "boot_us"),
)
"""``counted_id`` is the better recording of the same flight, which counts instead."""
_index_few("recording_copy", RECORDING.c.counted_id.is_not(None), RECORDING.c.counted_id)

VERDICT: Final = Table(
    "verdict",
    METADATA,
    _of("flight", key=True),
    Column("place", Integer, primary_key=True),
    _of("aircraft", nullable=False),
    _whole("start_us"),
    Column("vehicle", Integer),
    *map(_text, ("subject", "actuator", "condition", "worst")),
    *_numbers("urgency", "friction_nm"),
    *map(_text, ("reason", "suspect", "finding")),
    *map(_flag, ("counts", "last")),
    Index("verdict_by_actuator", "aircraft_id", "actuator", "vehicle", "start_us"),
)
"""``finding`` is the indicator to show, of the suspected fault if there is one; ``counts`` is false where
another recording of the flight counts; ``last`` is true in an actuator's last flight."""
_index_few("verdict_last", VERDICT.c.last == true(), VERDICT.c.aircraft_id)


def _of_verdict() -> tuple[Column[Any], Column[Any], ForeignKeyConstraint]:
    key = ForeignKeyConstraint(
        ["flight_id", "place"], ["verdict.flight_id", "verdict.place"], ondelete="CASCADE"
    )
    return Column("flight_id", BigInteger, primary_key=True), Column("place", Integer, primary_key=True), key


INDICATOR: Final = Table(
    "indicator",
    METADATA,
    *_of_verdict(),
    _text("fault", primary_key=True),
    *map(_text, ("quantity", "unit")),
    *_numbers("estimate", "low", "high", "error", "highest", "degraded", "emergency"),
    sqlite_with_rowid=False,  # those of a flight lie together
)
"""``error`` is the standard error of the part that differs between flights, ``highest`` the highest estimate
in flight that decided a condition."""

RECORD: Final = Table("record", METADATA, *_of_verdict(), _text("own"), _text("verdict", nullable=False))
"""``verdict`` is the whole one, as JSON: apart, for a trend reads the columns of thousands from few pages.
``own`` is what own-scale equations need of it; NULL where there is nothing."""

STANDING: Final = Table(
    "standing",
    METADATA,
    _id(),
    _of("aircraft", nullable=False),
    _whole("stored_us", nullable=False),
    _text("standings", nullable=False),
    Index("standing_by_time", "aircraft_id", "stored_us", "id"),
)
REPAIR: Final = Table(
    "repair", METADATA, _id(), _of("aircraft"), _text("actuator"), _whole("since_us", nullable=False)
)
"""NULL means every aircraft, or every actuator."""

JOURNAL: Final = Table(
    "journal",
    METADATA,
    _id(),
    _whole("at_us", nullable=False),
    *map(_text, ("who", "note", "kind", "before", "after", "logs")),
    _flag("undone"),
)
"""``logs`` is JSON: path, hash, aircraft and ``pinned`` of each log before the correction."""

SETTING: Final = Table("setting", METADATA, _text("name", primary_key=True), _text("value", nullable=False))
