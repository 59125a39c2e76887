"""The aircraft's response about an axis: converts flight rows to evidence, and evidence to a condition."""
