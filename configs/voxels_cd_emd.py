"""The paper's best voxel head: clouds of networks trained by CD and EMD, and a predicted volume.

Command: python -m psgn_jax.main --config=configs/voxels_cd_emd.py --config.data.path=RECORDS
             --config.voxels.from_cd=runs/cd --config.voxels.from_emd=runs/emd
             --config.voxels.from_volume=runs/voxels_volume
Hardware: a GPU.
Time: not measured.
Expect: not measured at full size; small runs: `psgn study comparison`.

Without the volume channel: --config.voxels.from_volume="".
"""

import ml_collections

from psgn_jax.config import Config, to_dict


def get_config() -> ml_collections.ConfigDict:
    config = ml_collections.ConfigDict(to_dict(Config()))
    config.task = "refine"
    config.voxels.from_cd = "runs/cd"
    config.voxels.from_emd = "runs/emd"
    config.voxels.from_volume = "runs/voxels_volume"
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
