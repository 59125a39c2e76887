"""Connects the rooms: takes the bytes of a flight and returns events and verdicts."""
