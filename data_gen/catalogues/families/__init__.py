"""Parametric families of objects, listed in `data_gen.catalogues.procedural`."""
