"""Models for an actuator: flights to learn from, and the training itself."""
