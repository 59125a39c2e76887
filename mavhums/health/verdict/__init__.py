"""Verdicts: findings in words, with the reason and the remedy where nothing can be said."""
