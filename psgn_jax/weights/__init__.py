"""Trained weights: their file format, the files that come with the package, and what opens them.

A file `<name>.safetensors` in this folder is part of the package and is found by its name.
"""
