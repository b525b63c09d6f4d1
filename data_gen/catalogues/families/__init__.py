"""Parametric families of objects; `data_gen.catalogues.procedural` says what they promise."""
