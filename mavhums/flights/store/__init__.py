"""The store: aircraft, their flights, and the verdicts on them, in a SQLite file or in PostgreSQL."""

from mavhums.flights.store.database import LogFile, Row, Store

__all__ = ["LogFile", "Row", "Store"]
