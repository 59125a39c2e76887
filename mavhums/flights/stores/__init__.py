"""Places to keep flights: a folder of one aircraft's, and the tables of a fleet."""
