"""The paper's best voxel post-processing: two clouds and the size of the object.

Command: python -m psgn_jax.main --config=configs/voxels_cd_emd.py --config.data.path=RECORDS
             --config.voxels.from_cd=runs/cd --config.voxels.from_emd=runs/emd
             --config.voxels.from_volume=runs/voxels_volume
Hardware: a GPU.
Expect: not measured at full size; small runs: `psgn study comparison`.

The clouds are those of a network trained with the CD and of one trained with the EMD. To leave out
the predicted size of the object: --config.voxels.from_volume="".
"""

import ml_collections

from psgn_jax.config import files


def get_config() -> ml_collections.ConfigDict:
    config = files.load("voxels_cd")
    config.voxels.from_emd = "runs/emd"
    config.voxels.from_volume = "runs/voxels_volume"
    return config
