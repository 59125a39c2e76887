"""A multirotor that flies in closed loop, with motors that lose thrust: an independent witness.

:mod:`~mavhums_sim.multirotor.craft` draws aircraft and flights, :mod:`~mavhums_sim.multirotor.flight` flies
them, :mod:`~mavhums_sim.multirotor.log` writes what an autopilot would record.
"""
