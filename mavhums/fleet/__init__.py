"""Judges the logs of many aircraft into one store, and reports from the store."""

from mavhums.fleet.landing import Past, against, analyse, keep, past
from mavhums.fleet.queries import export, status, trend, verdicts, worst
from mavhums.fleet.repairing import change_repairs
from mavhums.fleet.repairs import Repair, repairs_in
from mavhums.fleet.scan import ScanOptions, scan

__all__ = [
    "Past",
    "Repair",
    "ScanOptions",
    "against",
    "analyse",
    "change_repairs",
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
