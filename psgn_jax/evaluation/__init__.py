"""Metrics of predictions, tables, and the evaluation of trained networks."""
