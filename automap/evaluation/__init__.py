"""Comparison of a run's results with truth."""
