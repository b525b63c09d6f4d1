"""The paper's voxel head on the clouds of one network trained by the Chamfer distance.

Command: python -m psgn_jax.main --config=configs/voxels_cd.py --config.data.path=RECORDS
             --config.voxels.from_cd=runs/cd
Hardware: a GPU; two CPU cores with --config.voxels.widths='(8,8,8,8,8)' and a small network in
    `from_cd`, whose `data.image_size` and `data.inputs` have to be repeated here.
Time: not measured.
Expect: not measured at full size; small runs: `psgn study comparison`.

The records have to hold solid volumes. To add the volume channel, train
`configs/voxels_volume.py` and give --config.voxels.from_volume=runs/voxels_volume.
"""

import ml_collections

from psgn_jax.config import Config, to_dict


def get_config() -> ml_collections.ConfigDict:
    config = ml_collections.ConfigDict(to_dict(Config()))
    config.task = "refine"
    config.voxels.from_cd = "runs/cd"
    config.data.flip = True
    config.optim.learning_rate = 1e-3
    config.optim.schedule = "cosine"
    config.optim.warmup_steps = 200
    config.optim.final_fraction = 0.01
    config.optim.clip_norm = 1.0
    config.train.batch_size = 32
    config.train.steps = 20000
    config.train.eval_every = 2000
    config.train.images_every = 0
    return config
