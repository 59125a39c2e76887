"""Judges the logs of many aircraft into one store, and reports from the store."""

from mavhums.fleet.scan import ScanOptions, scan
from mavhums.flights.corrections import change_repairs, journal, move, remove, rename, repairs_in, undo
from mavhums.flights.queries import verdicts, worst
from mavhums.flights.reports import digest, export, status, trend
from mavhums.flights.store.logs import Repair

__all__ = [
    "Repair",
    "ScanOptions",
    "change_repairs",
    "digest",
    "export",
    "journal",
    "move",
    "remove",
    "rename",
    "repairs_in",
    "scan",
    "status",
    "trend",
    "undo",
    "verdicts",
    "worst",
]
