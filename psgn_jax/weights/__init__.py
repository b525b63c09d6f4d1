"""Trained weights: the file format, the files in the package, and functions that open them.

Files `<name>.safetensors` in this folder are part of the package and can be opened by name.
"""
