"""Judges the motors of a multirotor by what its autopilot asks of them and what the airframe does."""
