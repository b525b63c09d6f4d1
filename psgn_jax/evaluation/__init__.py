"""Metrics of predictions, their tables, and the evaluation of trained networks."""
