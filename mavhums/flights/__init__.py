"""Flights over time: an aircraft's earlier flights, its baselines and its trends."""
