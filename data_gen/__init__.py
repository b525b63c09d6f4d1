"""Renders meshes to training records (`psgn_jax.data.schema`): the data stage of the paper.

From `psgn_jax` this package imports only the modules that define, read and write records
(`data.schema`, `data.codec`, `data.manifest`, `data.dataset`, `files`), ShapeNet's category names
(`data.synsets`), the checker of configurations (`structured`), the locks of folders (`claims`) and
the checks of untrusted text (`untrusted`).
"""

import pathlib

ROOT = pathlib.Path(__file__).resolve().parents[1]
"""The folder that contains this package."""
