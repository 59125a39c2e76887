"""Decision: estimates against limits and baselines, for any kind of subject."""
