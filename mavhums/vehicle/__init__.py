"""What the vehicle did and was told: parameters, outputs, attitude, position, mode."""
