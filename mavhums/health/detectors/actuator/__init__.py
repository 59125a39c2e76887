"""Detectors of one actuator's faults; every module with a ``DETECTOR`` is found."""
