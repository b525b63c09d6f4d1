"""The paper's conditional variational autoencoder under the EMD, 300,000 steps at batch 32.

Command: python -m psgn_jax.main --config=configs/vae_emd.py --config.data.path=RECORDS
Hardware: a GPU.
Time: not measured.
Expect: not measured. Without `--config.data.path` it trains on the default data set.

As `vae_cd.py`, but for the loss, the paper's earth mover's distance of the 1,024 predicted points
from as many of the ground truth, to 1 % by auction, and the weight of the divergence, **ours**: 1.
"""

import ml_collections

from psgn_jax.config import Config, to_dict


def get_config() -> ml_collections.ConfigDict:
    config = ml_collections.ConfigDict(to_dict(Config()))
    config.model.random_size = 128
    config.model.posterior = True
    config.loss.name = "emd_sum"
    config.loss.kl_weight = 1.0
    config.loss.kl_warmup_steps = 10_000
    config.data.num_points = 1024
    config.optim.learning_rate = 3e-5
    config.train.batch_size = 32
    config.train.steps = 300_000
    return config
