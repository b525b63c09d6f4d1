"""The paper's conditional variational autoencoder with the EMD: 300,000 Adam steps, batch size 32.

Command: python -m psgn_jax.main --config=configs/vae_emd.py --config.data.path=RECORDS
Hardware: a GPU; not measured. Without `--config.data.path` it trains on the default data set.

This is `vae_cd.py` with another loss and another weight of the KL divergence. The loss is the
paper's earth mover's distance between the 1,024 predicted points and 1,024 points of the ground
truth, to 1 % by auction. The weight is 1 (**ours**). The volume Y that z encodes is made from the
same 1,024 points.
"""

import ml_collections

from psgn_jax.config import files


def get_config() -> ml_collections.ConfigDict:
    config = files.load("vae_cd")
    config.loss.name = "emd_sum"
    config.loss.kl_weight = 1.0
    config.data.num_points = 1024
    return config
