"""A tiny network for 30 steps on the default data set, to test that everything runs.

Command: python -m psgn_jax.main --config=configs/debug.py --workdir=runs/debug
Hardware: any CPU.
Time: 20 seconds on 2 cores, most of it for compilation.
Expect: the loss falls; the metrics are not meaningful.
"""

import ml_collections

from psgn_jax.config import Config, to_dict


def get_config() -> ml_collections.ConfigDict:
    config = ml_collections.ConfigDict(to_dict(Config()))
    config.data.image_size = (48, 64)
    config.data.num_points = 256
    config.data.num_eval_points = 512
    config.model.widths = (8, 16, 32, 64)
    config.model.fc_points = 64
    config.model.fc_widths = (64,)
    config.model.deconv_level = 2
    config.optim.learning_rate = 1e-3
    config.train.batch_size = 8
    config.train.steps = 30
    config.train.log_every = 10
    config.train.eval_every = 15
    config.train.checkpoint_every = 10
    config.train.images_every = 15
    config.eval.batch_size = 16
    config.eval.max_samples = 32
    return config
