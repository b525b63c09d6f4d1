"""Renders meshes to training records (`psgn_jax.data.schema`): the data stage of the paper.

From `psgn_jax` this package imports only the modules that define and write records, `files`,
`claims`, `untrusted` and the checker of configurations (`structured`). The list is
`DATA_GEN_MAY_IMPORT` in `tests/test_architecture.py`.
"""

import pathlib

ROOT = pathlib.Path(__file__).resolve().parents[1]
"""The folder that contains this package."""
