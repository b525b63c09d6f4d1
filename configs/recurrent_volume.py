"""3D-R2N2, the baseline of the paper: one to five images to a volume, trained with cross-entropy.

Command: python -m psgn_jax.main --config=configs/recurrent_volume.py --config.data.path=RECORDS
Hardware: a GPU; on two CPU cores with --config.voxels.width_multiplier=0.125.
Expect: not measured at full size; small runs: `psgn study comparison`.

The records must contain solid volumes and at least five views of every model; with fewer views set
`voxels.max_views` and `voxels.eval_views`. The batch size 36, 60,000 Adam steps, the learning rate
1e-4 and the image size 127x127 are those of the published code of 3D-R2N2. Unlike the original, the
network predicts in the frame of the first view, as `psgn_jax.tasks.voxels` explains.
"""

import ml_collections

from psgn_jax.config import Config, to_dict


def get_config() -> ml_collections.ConfigDict:
    config = ml_collections.ConfigDict(to_dict(Config()))
    config.task = "views"
    config.data.image_size = (127, 127)
    config.data.inputs = ("rgb",)
    config.data.flip = True
    config.optim.learning_rate = 1e-4
    config.optim.clip_norm = 1.0
    config.train.batch_size = 36
    config.train.steps = 60_000
    config.train.images_every = 0
    return config
