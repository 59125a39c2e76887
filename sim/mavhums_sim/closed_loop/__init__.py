"""Closed-loop simulation of an aircraft: JSBSim dynamics, an autopilot, and surfaces that can fail."""

from __future__ import annotations

from mavhums_sim.closed_loop.aircraft import Air, Dispersion
from mavhums_sim.closed_loop.flight import FlownLoop, fly_closed_loop
from mavhums_sim.closed_loop.scenario import ClosedLoop, Confounder
from mavhums_sim.closed_loop.surfaces import SurfaceFault

__all__ = ["Air", "ClosedLoop", "Confounder", "Dispersion", "FlownLoop", "SurfaceFault", "fly_closed_loop"]
