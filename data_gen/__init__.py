"""Renders meshes to training records (`psgn_jax.data.schema`): the data stage of the paper.

From `psgn_jax` it imports only `data`, `system`, `array_types`, `config.structured` and
`config.command_line`.
"""
