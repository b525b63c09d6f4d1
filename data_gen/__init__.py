"""Meshes, cameras and light to records of `psgn_jax.data.schema`: the paper's data stage.

From `psgn_jax` this package imports only the modules that define and write records (`data.schema`,
`data.codec`, `data.manifest`, `data.dataset`, `data.synsets`, `files`) and the checker of
configurations (`structured`).
"""

import pathlib

ROOT = pathlib.Path(__file__).resolve().parents[1]
"""The folder that contains this package."""
