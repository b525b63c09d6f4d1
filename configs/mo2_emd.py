"""The paper's Mo2 with the EMD: the better of two samples of r, 300,000 Adam steps, batch size 32.

Command: python -m psgn_jax.main --config=configs/mo2_emd.py --config.data.path=RECORDS
Hardware: a GPU; not measured. Without `--config.data.path` it trains on the default data set.

The recipe is that of `mo2_cd.py`, with the paper's earth mover's distance between the 1,024
predicted points and 1,024 points of the ground truth, to 1 % by auction.
"""

import ml_collections

from psgn_jax.config import files


def get_config() -> ml_collections.ConfigDict:
    config = files.load("mo2_cd")
    config.loss.name = "emd_sum"
    config.data.num_points = 1024
    return config
