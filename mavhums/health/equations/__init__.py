"""The equations that an actuator's samples obey; detectors read their coefficients.

An equation is a module with ``TERMS``, ``prior(actuator)`` and ``terms(actuator, motion)``.
"""
