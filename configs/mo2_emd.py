"""The paper's Mo2 with the EMD: the better of two samples of r, 300,000 Adam steps, batch size 32.

Command: python -m psgn_jax.main --config=configs/mo2_emd.py --config.data.path=RECORDS
Hardware: a GPU; not measured. Without `--config.data.path` it trains on the default data set.

Source: paper, sections 4 and 5 and "Implementation details". The network takes an image and a
random vector r ~ N(0, I). For two samples of r the paper's earth mover's distance between the 1,024
predicted points and 1,024 points of the ground truth is computed, to 1 % by auction, and the
smaller one is the loss (MoN with n = 2). The paper gives neither the size of r nor a learning rate:
128 is **ours**, 3e-5 is from the authors' code. Evaluation uses one sample of r.
"""

import ml_collections

from psgn_jax.config import files


def get_config() -> ml_collections.ConfigDict:
    config = files.load("mo2_cd")
    config.loss.name = "emd_sum"
    config.data.num_points = 1024
    return config
