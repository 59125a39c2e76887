"""Servos without a data sheet, compared with their own earlier flights: friction in units of the own current.

A flight leaves sums (:mod:`~mavhums.health.estimation.flight_sums`); the comparison with earlier flights is a
pure function of stored sums (:mod:`~mavhums.health.self_baseline.comparison`), which needs no log.
"""
