"""Converts messages to the paper's quantities V1–V12 of each actuator, without judging them."""
