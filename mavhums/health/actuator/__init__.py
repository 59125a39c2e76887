"""Actuators with telemetry: detectors, monitor and networks' votes."""
