"""Renders meshes to training records (`psgn_jax.data.schema`): the data stage of the paper.

From `psgn_jax` this package imports only `data`, `config.structured` and `system`.
"""

import psgn_jax  # noqa: F401 - first, because it guards the import path of `python -m`
