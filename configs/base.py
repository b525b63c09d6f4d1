"""The defaults of all fields in `psgn_jax.config.experiment`: the two-branch network at full size.

Command: python -m psgn_jax.main --config=configs/base.py --workdir=runs/base
A starting point for other configurations.
"""

import ml_collections

from psgn_jax.config import Config, to_dict


def get_config() -> ml_collections.ConfigDict:
    return ml_collections.ConfigDict(to_dict(Config()))
