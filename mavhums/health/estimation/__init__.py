"""Estimation: slots, windows, motion, equations, least squares and the sums of a flight. Decides nothing."""
