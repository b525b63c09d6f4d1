"""The paper's recipe under the Chamfer distance: 300,000 steps of Adam at batch 32, with input r.

Command: python -m psgn_jax.main --config=configs/mo2_cd.py --config.data.path=RECORDS
Hardware: a GPU.
Time: not measured.
Expect: not measured. Without `--config.data.path` it trains on the default data set.

Source: paper, sections 4 and 5 and "Implementation details": the network takes an image and a
random vector r ~ N(0, I); the loss is the paper's sum over both directions of squared distances.
One draw of r is trained on for each sample; the minimum over two draws, which gives the recipe its
name, is not built yet. The paper names no learning rate; 3e-5 is the authors'.
"""

import ml_collections

from psgn_jax.config import Config, to_dict


def get_config() -> ml_collections.ConfigDict:
    config = ml_collections.ConfigDict(to_dict(Config()))
    config.model.random_size = 128
    config.loss.name = "chamfer_sq"
    config.optim.learning_rate = 3e-5
    config.train.batch_size = 32
    config.train.steps = 300_000
    return config
