"""Health monitoring: converts quantities to evidence, and evidence to a verdict."""

from __future__ import annotations

from mavhums.health.monitor import Monitor

__all__ = ["Monitor"]
