"""The paper's conditional variational autoencoder with the EMD: 300,000 Adam steps, batch size 32.

Command: python -m psgn_jax.main --config=configs/vae_emd.py --config.data.path=RECORDS
Hardware: a GPU.
Time: not measured.
Expect: not measured. Without `--config.data.path` it trains on the default data set.

This is `vae_cd.py` with another loss and another weight of the divergence. The loss is the paper's
earth mover's distance between the 1,024 predicted points and 1,024 points of the ground truth, to
1 % by auction. The weight is 1 (**ours**).
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
