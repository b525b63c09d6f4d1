"""The recipe of `authors_small.py` with the CD alone as its loss, for comparing data and losses.

Command: psgn convert authors SRC records/authors
         python -m psgn_jax.main --config=configs/authors_small_cd.py --workdir=runs/by_cd
Hardware: two CPU cores (5.2 M parameters).
Time: a step takes .11 s (docs/benchmarks.md).
Expect: cd_sq_radius2 of .0105 and emd_radius of .309 on the validation split, at the last step.
"""

import ml_collections

from psgn_jax.config import files


def get_config() -> ml_collections.ConfigDict:
    config = files.load("authors_small")
    config.loss.name = "chamfer_sq_mean"
    return config
