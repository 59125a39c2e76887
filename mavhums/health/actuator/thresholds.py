"""Numbers of the actuators' detectors that decide a verdict: what each trades, and what set it."""

from __future__ import annotations

from typing import Final

LEAST_FLANK_SLOTS: Final = 3
"""Minimum number of slots with load on either flank; fewer give no reliable error."""
