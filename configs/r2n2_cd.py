"""The two-branch network for the images of 3D-R2N2: 128x128 pixels, three channels.

Command: psgn convert r2n2 SRC records/r2n2
         python -m psgn_jax.main --config=configs/r2n2_cd.py --workdir=runs/r2n2_cd
Hardware: a GPU; not measured.

The authors published widths of 32 to 512, a deconv branch of 16x16 cells with 9 channels (768
points) and an fc branch of 256 points. They do not give the number of levels; six levels, down to
4x4, are **ours**. The converted data have the splits `train` and `test` but no validation split.
"""

import ml_collections

from psgn_jax.config import Config, to_dict


def get_config() -> ml_collections.ConfigDict:
    config = ml_collections.ConfigDict(to_dict(Config()))
    config.data.path = "records/r2n2"
    config.data.image_size = (128, 128)
    config.data.inputs = ("rgb",)
    config.data.eval_split = "test"
    config.data.flip = True
    config.model.widths = (32, 64, 128, 256, 512, 512)
    config.model.deconv_level = 3
    config.model.deconv_channels = 9
    config.optim.learning_rate = 3e-4
    config.optim.schedule = "cosine"
    config.optim.warmup_steps = 500
    config.optim.final_fraction = 0.01
    config.optim.clip_norm = 1.0
    config.train.batch_size = 32
    config.train.steps = 100_000
    config.eval.max_samples = 4096
    return config
