"""Judges the logs of many aircraft into one store, and reports from the store."""

from mavhums.fleet.landing import Past, against, analyse, keep, past
from mavhums.fleet.queries import export, status, trend, verdicts, worst
from mavhums.fleet.repairs import Repair
from mavhums.fleet.scan import ScanOptions, scan

__all__ = [
    "Past",
    "Repair",
    "ScanOptions",
    "against",
    "analyse",
    "export",
    "keep",
    "past",
    "scan",
    "status",
    "trend",
    "verdicts",
    "worst",
]
