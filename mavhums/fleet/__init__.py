"""Judges the logs of many aircraft into one store, and reports from the store."""

from mavhums.fleet.landing import Past, against, analyse, keep, past
from mavhums.fleet.scan import ScanOptions, scan
from mavhums.fleet.second_pass import change_repairs
from mavhums.flights.changes import digest
from mavhums.flights.queries import export, status, trend, verdicts, worst
from mavhums.flights.repairs import Repair, repairs_in

__all__ = [
    "Past",
    "Repair",
    "ScanOptions",
    "against",
    "analyse",
    "change_repairs",
    "digest",
    "export",
    "keep",
    "past",
    "repairs_in",
    "scan",
    "status",
    "trend",
    "verdicts",
    "worst",
]
