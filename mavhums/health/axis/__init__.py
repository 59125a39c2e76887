"""Axes: the aircraft's response about roll, pitch and yaw, from rows of the flight to a condition."""
