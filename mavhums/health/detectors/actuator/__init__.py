"""Detectors of an actuator's faults; every module with a ``DETECTOR`` is discovered."""
