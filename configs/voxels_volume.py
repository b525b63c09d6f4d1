"""The network that predicts the size of the object (its log-volume, one number).

Command: python -m psgn_jax.main --config=configs/voxels_volume.py --config.data.path=RECORDS
Hardware: a GPU.
Expect: not measured at full size; small runs: `psgn study comparison`.

Its prediction is an input of the voxel post-processing (`voxels_cd_emd.py`).
"""

import ml_collections

from psgn_jax.config import Config, to_dict


def get_config() -> ml_collections.ConfigDict:
    config = ml_collections.ConfigDict(to_dict(Config()))
    config.task = "volume"
    config.data.flip = True
    config.optim.learning_rate = 3e-4
    config.optim.schedule = "cosine"
    config.optim.warmup_steps = 200
    config.optim.final_fraction = 0.01
    config.optim.clip_norm = 1.0
    config.train.batch_size = 32
    config.train.steps = 20000
    config.train.eval_every = 2000
    config.train.images_every = 0
    return config
