"""Readers of models: our own for OBJ and MTL, trimesh for all others.

They open only files of the given `files.Files`. The resources are bounded: the bytes of a file, the
number of faces (checked before they are built if the format permits), and the pixels decoded and
kept.
"""
