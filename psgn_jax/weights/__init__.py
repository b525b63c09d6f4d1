"""Trained weights: file format, checkpoints, run folders, and the weights in the package.

The package contains the files `<name>.safetensors` in this folder; they can be opened by name.
"""
