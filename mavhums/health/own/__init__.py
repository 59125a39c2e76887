"""A servo without a data sheet, judged against its own past: friction in units of its own current.

A flight alone gives sums (:mod:`~mavhums.health.own.record`); what they mean against the flights before is a
pure function over stored sums (:mod:`~mavhums.health.own.judge`), which needs no log.
"""
