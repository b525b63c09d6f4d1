"""Parametric families of objects, described in `data_gen.catalogues.procedural`."""
