"""Shape completion from RGB-D: the full two-branch network on colour, mask and depth, with the CD.

Command: psgn convert authors SRC records/authors
         python -m psgn_jax.main --config=configs/rgbd_cd.py --workdir=runs/rgbd_cd
Hardware: a GPU; on two CPU cores a step takes one to two seconds (docs/benchmarks.md).
Expect: a lower cd_sq_radius2 than that of `authors.py`, mainly because of visible points; not
measured at this size. A smaller network, trained with EMD + 5 CD, had .0104 with depth and .0141
without after 1,000 steps (docs/experiments.md).

The recipe is that of `authors.py`. All records with depth can be used
(`--config.data.path=RECORDS`). `models.networks.stack_channels` describes the depth channels.
A smaller comparison of RGB and RGB-D for two CPU cores is `psgn study completion`.

Source: paper, section "3D Shape Completion from RGBD Images", which gives no separate recipe.
"""

import ml_collections

from psgn_jax.config import files


def get_config() -> ml_collections.ConfigDict:
    config = files.load("authors")
    config.data.inputs = ("rgb", "mask", "depth")
    return config
