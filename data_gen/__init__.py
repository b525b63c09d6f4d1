"""Meshes, cameras and light to records of `psgn_jax.data.schema`: the paper's data stage.

Of the package `psgn_jax` this one imports the modules alone that say what records are and how they
are written (`data.schema`, `data.codec`, `data.manifest`, `data.dataset`, `files`), and the checker
of configurations (`structured`).
"""

import pathlib

ROOT = pathlib.Path(__file__).resolve().parents[1]
"""The folder that this package lies in."""
