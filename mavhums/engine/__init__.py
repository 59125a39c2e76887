"""The composition of the rooms: bytes of a flight in, events and verdicts out."""
