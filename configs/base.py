"""Defaults of every field: the two-branch network at full size, as `psgn_jax.config` states them.

Command: python -m psgn_jax.main --config=configs/base.py --workdir=runs/base
Hardware, time and number to expect: none; the other configurations start from this one.
"""

import ml_collections

from psgn_jax.config import Config, to_dict


def get_config() -> ml_collections.ConfigDict:
    return ml_collections.ConfigDict(to_dict(Config()))
