"""The full two-branch network on the authors' batches, at full image size.

Command: psgn convert authors SRC records/authors
         python -m psgn_jax.main --config=configs/authors.py --workdir=runs/authors
Hardware: a GPU; on two CPU cores a step takes one to two seconds (docs/benchmarks.md).
Expect: a lower cd_sq_radius2 than `authors_small.py`; a complete run has not been measured.

The recipe of `authors_small.py` with the published two-branch network and the CD as the loss. For
the authors' own recipe, add:
    --config.loss.name=chamfer_authors --config.loss.l2=authors
    --config.optim.schedule=constant --config.optim.final_fraction=0 --config.optim.warmup_steps=0
    --config.optim.learning_rate=3e-5 --config.optim.clip_norm=0 --config.optim.ema_decay=0
    --config.data.flip=False --config.data.stretch=0 --config.data.num_points=16384
"""

import ml_collections

from psgn_jax.config import Config, to_dict


def get_config() -> ml_collections.ConfigDict:
    config = ml_collections.ConfigDict(to_dict(Config()))
    config.data.path = "records/authors"
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
