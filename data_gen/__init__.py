"""Renders meshes to training records (`psgn_jax.data.schema`): the data stage of the paper.

From `psgn_jax` it imports only `data`, `system`, `array_types`, `config.structured` and
`config.command_line`.
"""

import psgn_jax  # noqa: F401 - first, because it guards the import path of `python -m`
