"""The paper's voxel post-processing of the clouds of one network, which is trained with the CD.

Command: python -m psgn_jax.main --config=configs/voxels_cd.py --config.data.path=RECORDS
             --config.voxels.from_cd=runs/cd
Hardware: a GPU; two CPU cores with --config.voxels.widths='(8,8,8,8,8)' and a small network in
    `from_cd`. `data.image_size` and `data.inputs` must be those of the run in `from_cd`.
Expect: not measured at full size; small runs: `psgn study comparison`.

The records must contain occupancy grids. To add the predicted size of the object as an input,
train `configs/voxels_volume.py` and pass --config.voxels.from_volume=runs/voxels_volume.
"""

import ml_collections

from psgn_jax.config import files


def get_config() -> ml_collections.ConfigDict:
    config = files.load("voxels_volume")
    config.task = "refiner"
    config.voxels.from_cd = "runs/cd"
    config.optim.learning_rate = 1e-3
    return config
