"""Readers of models, one module for each format; all end in `data_gen.parts`.

They open only files of the given `model_files.Files`, and bound the bytes of a file, the number of
faces (before they are built, if the format permits) and the pixels.
"""
