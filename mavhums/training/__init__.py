"""Training of models for an actuator, on simulated flights and precedents."""
