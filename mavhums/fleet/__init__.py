"""Judges the logs of many aircraft into one store, and reports from the store."""

from mavhums.fleet.queries import export, status, trend, verdicts, worst
from mavhums.fleet.repairs import Repair
from mavhums.fleet.scan import ScanOptions, scan

__all__ = ["Repair", "ScanOptions", "export", "scan", "status", "trend", "verdicts", "worst"]
