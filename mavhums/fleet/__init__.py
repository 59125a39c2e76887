"""Many aircraft: their logs judged side by side into one store, and what the store tells."""

from mavhums.fleet.queries import export, status, trend, verdicts, worst
from mavhums.fleet.scan import ScanOptions, scan

__all__ = ["ScanOptions", "export", "scan", "status", "trend", "verdicts", "worst"]
