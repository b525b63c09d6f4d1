"""Readers of models: own ones for OBJ, MTL, AC3D and Pyrogenesis, trimesh for other formats.

They open only files of the given `files.Files`. The resources are bounded: the bytes of a file, the
number of faces (checked before they are built if the format permits), and the pixels decoded and
kept.
"""
