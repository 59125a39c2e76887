"""Detectors: one module per fault, with a class named ``Detector``, discovered automatically."""
