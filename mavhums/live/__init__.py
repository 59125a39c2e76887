"""Feeds the engine from links: the verdicts in flight are those of the log.

Nothing here judges. Received data become the records of a telemetry log. The engine processes them and
the recorder stores them, so a session and its recording give the same verdicts.
"""
