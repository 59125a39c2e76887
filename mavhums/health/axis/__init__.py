"""How an aircraft answers about an axis: from flight rows to evidence, and to a condition."""
