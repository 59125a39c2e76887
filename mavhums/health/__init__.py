"""Health: from quantities to evidence, and from evidence to a verdict.

``estimation`` fits equations, ``decision`` compares estimates with limits and baselines, ``actuator``,
``axis`` and ``self_baseline`` judge one kind of subject each, and ``verdict`` words the result. Imports run
only this way.
"""
