"""From quantities to evidence, and from evidence to a verdict; it does not draw."""

from __future__ import annotations

from mavhums.health.monitor import Monitor

__all__ = ["Monitor"]
