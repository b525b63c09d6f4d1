"""Readers of models, one module for each format. They return parts, which `load` joins.

They open only files of a `model_files.Files`, and bound the bytes of a file, the number of faces
(before they are built, if the format permits) and the pixels.
"""
