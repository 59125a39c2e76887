"""Judges a servo without a data sheet by its own earlier flights: friction in units of its own current.

A flight gives sums (:mod:`~mavhums.health.own.record`); the comparison with earlier flights is a pure
function of stored sums (:mod:`~mavhums.health.own.judge`), which needs no log.
"""
