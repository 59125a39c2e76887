"""Detectors of axes, one file each; found by :mod:`mavhums.health.axis.detector`."""
