"""Five minutes of further training on your own data, starting from trained weights.

Command: python data_gen/render.py --catalogue=folder --source=my_meshes --out=records/mine
         python -m psgn_jax.main --config=configs/finetune.py --workdir=runs/tuned
             --config.data.path=records/mine --config.train.init=WEIGHTS
Hardware: two CPU cores.
Time: 4 min 46 s of CPU time on one core.
Expect: the evaluation at step 0 measures the given weights. On a folder of 74 models, the CD
squared of the validation models fell from .0061 to .0043 (docs/predict.md).

WEIGHTS is a file of weights, the folder of a run, or the name of weights in the package, listed by
`psgn weights list`. Network, input and loss are those of `pretrained.py`. If the
weights are from another network, an error names the layers that do not fit. The learning rate is
two fifths of that of `pretrained.py`, because the network is already trained.
"""

import ml_collections

from psgn_jax.config import files


def get_config() -> ml_collections.ConfigDict:
    config = files.load("pretrained")
    config.data.path = ""
    config.data.eval_path = ""
    config.train.init = "WEIGHTS"  # no such file: it must be given
    config.optim.learning_rate = 2e-4
    config.optim.warmup_steps = 50
    config.optim.ema_decay = 0.99
    config.train.steps = 600
    config.train.log_every = 50
    config.train.eval_every = 200
    config.train.checkpoint_every = 100
    config.train.images_every = 300
    config.train.keep_checkpoints = 2
    return config
