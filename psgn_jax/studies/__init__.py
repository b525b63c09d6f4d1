"""Experiments of the paper; `study` has their common parts."""
