"""Meshes, cameras and light to records of `psgn_jax.data.schema`: the paper's data stage.

Of the package `psgn_jax` this one imports `data.schema`, `data.records` and `types` alone.
"""
