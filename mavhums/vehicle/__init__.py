"""The state and the use of the vehicle: parameters, outputs, attitude, position, mode."""
