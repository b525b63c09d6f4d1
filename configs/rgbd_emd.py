"""Shape completion from RGB-D: the full two-branch network, colour, mask and depth, under the EMD.

Command: python -m psgn_jax.convert authors SRC records/authors
         python -m psgn_jax.main --config=configs/rgbd_emd.py --workdir=runs/rgbd_emd
Hardware: a GPU; on two CPU cores a step takes some seconds (docs/benchmarks.md).
Time: not measured.
Expect: a lower emd_radius than `authors_emd.py` gives and than `rgbd_cd.py`; not measured.

The recipe is that of `authors_emd.py`, 1,024 points of the truth included; any records with depth
will do (`--config.data.path=RECORDS`). What the network sees of the depth:
`models.inputs.stack_channels`.

Source: paper, section "3D Shape Completion from RGBD Images", which names no recipe of its own.
"""

import ml_collections

from psgn_jax.config import Config, to_dict


def get_config() -> ml_collections.ConfigDict:
    config = ml_collections.ConfigDict(to_dict(Config()))
    config.data.path = "records/authors"
    config.data.inputs = ("rgb", "mask", "depth")
    config.data.num_points = 1024
    config.loss.name = "emd_mean"
    config.data.flip = True
    config.data.stretch = 0.15
    config.optim.learning_rate = 3e-4
    config.optim.schedule = "cosine"
    config.optim.warmup_steps = 500
    config.optim.final_fraction = 0.01
    config.optim.clip_norm = 1.0
    config.optim.ema_decay = 0.999
    config.train.batch_size = 32
    config.train.steps = 20_000
    config.train.log_every = 50
    config.train.eval_every = 500
    config.train.checkpoint_every = 500
    config.train.images_every = 2_000
    return config
