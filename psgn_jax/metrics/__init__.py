"""Metrics of predicted clouds."""
