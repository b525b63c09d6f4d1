"""Renders meshes to training records (`psgn_jax.data.schema`): the data stage of the paper."""
