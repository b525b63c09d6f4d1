"""Readers of mesh files, a module for each format. They return parts, which `load` joins.

They open files only by `model_files.Files`. They limit the bytes of a file, the faces (before the
arrays exist, if the format permits) and the pixels of textures.
"""
