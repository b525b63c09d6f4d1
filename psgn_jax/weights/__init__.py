"""Trained weights: file format, checkpoints, run folders, and the package's files of weights."""
