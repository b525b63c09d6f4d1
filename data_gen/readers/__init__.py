"""Readers of models: our own for OBJ and MTL, trimesh for all others.

They open only files of the given `model_files.Files`, and bound the bytes of a file, the number of
faces (before they are built, if the format permits) and the pixels.
"""
