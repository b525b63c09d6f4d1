"""Renders meshes to training records (`psgn_jax.data.schema`): the data stage of the paper.

From `psgn_jax` this package imports only the modules that define and write records (`data.schema`,
`data.codec`, `data.manifest`, `data.dataset`, `data.synsets`, `files`), the checker of
configurations (`structured`), the locks of folders (`claims`) and the reading of untrusted text
(`untrusted`).
"""

import pathlib

ROOT = pathlib.Path(__file__).resolve().parents[1]
"""The folder that contains this package."""
