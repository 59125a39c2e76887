"""Health and usage monitoring of UAV servo actuators from MAVLink telemetry logs."""
__version__ = "0.1.0"
