"""Smooth signals for cyclograms."""

from __future__ import annotations

import numpy as np

from mavhums_sim._arrays import Array


def ramp(x: Array, start: float, end: float) -> Array:
    """Rise smoothly from 0 at ``start`` to 1 at ``end``."""
    s: Array = np.clip((x - start) / (end - start), 0.0, 1.0)
    smooth: Array = s * s * (3.0 - 2.0 * s)
    return smooth


def gusts(rng: np.random.Generator, time: Array, low_hz: float, high_hz: float, waves: int = 24) -> Array:
    """Return a smooth random signal of unit variance with a 1/f power spectrum in a band."""
    frequency = np.exp(rng.uniform(np.log(low_hz), np.log(high_hz), waves))
    shift = rng.uniform(0.0, 2 * np.pi, waves)
    total = np.zeros_like(time)
    for f, s in zip(frequency, shift, strict=True):
        total += np.sin(2 * np.pi * f * time + s)
    scaled: Array = total * np.sqrt(2.0 / waves)
    return scaled


def held(demand: Array, threshold: float) -> Array:
    """Return the demand after an autopilot's dead band: in steps of ``threshold``; as it is if that is 0."""
    if threshold == 0.0:
        return demand
    stairs: Array = np.round(demand / threshold) * threshold
    return stairs
