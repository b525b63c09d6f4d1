"""A two-branch network on half-size images of the authors' batches, for two CPU cores.

Command: psgn convert authors SRC records/authors
         python -m psgn_jax.main --config=configs/authors_small.py --workdir=runs/authors_small
Hardware: two CPU cores (5.2 M parameters).
Time: not measured; a step takes 1.5 times as long as one of `authors_small_cd.py`.
Expect: cd_sq_radius2 of .0106 and emd_radius of .132 on the validation split, at the last step.

The loss is the EMD to 1,024 of the true points plus five times the CD to all of them. It spreads
the predicted points evenly, at nearly the CD of a training with the CD alone (docs/choosing.md).
"""

import ml_collections

from psgn_jax.config import Config, to_dict


def get_config() -> ml_collections.ConfigDict:
    config = ml_collections.ConfigDict(to_dict(Config()))
    config.data.path = "records/authors"
    config.data.image_size = (96, 128)
    config.data.num_points = 2048
    config.data.flip = True
    config.data.stretch = 0.2
    config.data.zoom = 0.05
    config.data.shift = 0.04
    config.data.colour_jitter = 0.2
    config.model.widths = (8, 16, 32, 64, 128, 256)
    config.model.deconv_level = 2
    config.model.fc_widths = (768, 512)
    config.loss.name = "emd_mean@1024 + 5*chamfer_sq_mean"
    config.optim.learning_rate = 1e-3
    config.optim.schedule = "cosine"
    config.optim.warmup_steps = 200
    config.optim.final_fraction = 0.01
    config.optim.clip_norm = 1.0
    config.optim.ema_decay = 0.998
    config.train.batch_size = 16
    config.train.steps = 3200
    config.train.log_every = 50
    config.train.eval_every = 400
    config.train.checkpoint_every = 400
    config.train.images_every = 1000
    return config
