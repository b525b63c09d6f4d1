"""The paper's conditional variational autoencoder with the CD: 300,000 Adam steps, batch size 32.

Command: python -m psgn_jax.main --config=configs/vae_cd.py --config.data.path=RECORDS
Hardware: a GPU; not measured. Without `--config.data.path` it trains on the default data set.

Source: paper, section "Generation of Multiple Plausible Shapes". During training, z is sampled from
a VoxNet-like network that reads the volume of the ground truth (`psgn_jax.models.posterior`); at
test time it is sampled from N(0, I). The paper gives neither sizes nor the weight of the KL
divergence. **Ours**:

- z has 128 components, like r.
- The weight is 0.3. By the rule in `psgn_jax.config.experiment.LossConfig`, this assumes a
  standard deviation of sqrt(0.3 / 2) = .39 for each coordinate of a point. The loss is the sum of
  5,120 squared distances; for the mean CD, the corresponding weight is about 1e-4. In
  `psgn_jax.studies.ambiguity`, 2e-4 worked; with 5e-4, z had too little effect.
- There are 4,096 true points for 1,024 predicted ones, so in the sum the direction from truth to
  prediction weighs four times as much as the other one (`mo2_cd.py` says why).
- The weight rises over the first 10,000 steps. Otherwise the KL divergence could make z carry no
  information before the generator has learned to use it.
"""

import ml_collections

from psgn_jax.config import files


def get_config() -> ml_collections.ConfigDict:
    config = files.load("mo2_cd")
    config.model.posterior = True
    config.loss.min_of_n = 1
    config.loss.kl_weight = 0.3
    config.loss.kl_warmup_steps = 10_000
    return config
