"""The equations of an actuator's samples; detectors read their coefficients.

An equation is a module with ``TERMS``, ``prior(actuator)`` and ``terms(actuator, motion)``.
"""
