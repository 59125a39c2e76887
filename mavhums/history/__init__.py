"""Flights over time: an aircraft's earlier flights, and what they tell of the next."""
