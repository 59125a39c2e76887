"""Judges the logs of many aircraft into one store, and reports from the store."""

from mavhums.fleet.corrections import corrections_in, reassign, remove, rename, restore
from mavhums.fleet.landing import Past, against, analyse, keep, past
from mavhums.fleet.scan import ScanOptions, scan
from mavhums.fleet.second_pass import change_repairs
from mavhums.flights.corrections import Repair, repairs_in
from mavhums.flights.queries import status, trend, verdicts, worst
from mavhums.flights.reports import digest, export

__all__ = [
    "Past",
    "Repair",
    "ScanOptions",
    "against",
    "analyse",
    "change_repairs",
    "corrections_in",
    "digest",
    "export",
    "keep",
    "past",
    "reassign",
    "remove",
    "rename",
    "repairs_in",
    "restore",
    "scan",
    "status",
    "trend",
    "verdicts",
    "worst",
]
