"""Shape completion from RGB-D: the full two-branch network on colour, mask and depth, with the EMD.

Command: psgn convert authors SRC records/authors
         python -m psgn_jax.main --config=configs/rgbd_emd.py --workdir=runs/rgbd_emd
Hardware: a GPU; on two CPU cores a step takes one to two seconds (docs/benchmarks.md).
Expect: a lower emd_radius than those of `authors_emd.py` and `rgbd_cd.py`; not measured.

The recipe is that of `authors_emd.py`, including the 1,024 ground-truth points, with the input of
`rgbd_cd.py`.
"""

import ml_collections

from psgn_jax.config import files


def get_config() -> ml_collections.ConfigDict:
    config = files.load("authors_emd")
    config.data.inputs = ("rgb", "mask", "depth")
    return config
