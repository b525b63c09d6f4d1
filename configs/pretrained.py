"""The recipe of the weights that come with the package: a sampler, trained on permissive data.

Command: python scripts/free_set.py --packages FOLDER --out records/free
             --sources=furniture,procedural,procedural_incomplete,collections
         python scripts/free_set.py --packages FOLDER --out records/others --photo=0.2
             --angles=0.5 --level=0.3 --sources=furniture,collections
         python -m psgn_jax.main --config=configs/pretrained.py --workdir=runs/pretrained
         psgn weights export --workdir=runs/pretrained --out=pretrained.safetensors
             --sources=records/free/sources.json
Hardware: two CPU cores (5.4 M parameters), in the background. After SIGTERM it saves a checkpoint,
and the same command resumes.
Time: 14 hours on one core (AMD, AVX-512), estimated from 32 samples/s; not run to the end.
Expect: not measured. The weights in the package were trained in shorter runs: four of a
deterministic network, then one of the sampler, which started from it (docs/journal.md). To start
from the weights in the package, add `--config.train.init=NAME` (`psgn weights list`).

Data: renders of models with permissive licences, from the authors' angle, from other and low
heights, and path-traced. `*4` counts each sample of a folder four times. To leave out data sets,
list the others: `--config.data.path=records/free/furniture,records/mine`.

Photos: 30 % of the samples from the authors' angle are cropped and placed like photos
(`data.place`), as are all samples from other angles. All samples are scaled and shifted a little,
and stretched sideways by up to 30 % if the camera is not rolled (`data.stretch`).
Masks and images have the effects of photos (`data.photo`).

Loss: the EMD to 1,024 of the true points, with an error of up to 10 %, plus five times the CD to
all of them (docs/experiments.md compares other factors), for the best of 8 clouds of each sample.
The Chamfer distance of 128 points finds it. The CD of the first cloud is added, so that all clouds
stay plausible.
"""

import ml_collections

from psgn_jax.config import files

DATA = (
    "records/free/furniture",
    "records/free/collections",
    "records/free/procedural",
    "records/free/procedural_incomplete",
    "records/others/photo/furniture*4",
    "records/others/photo/collections*4",
    "records/others/angles/furniture*2",
    "records/others/angles/collections*2",
    "records/others/level/furniture*2",
    "records/others/level/collections*2",
)


def get_config() -> ml_collections.ConfigDict:
    config = files.load("authors_small")
    config.data.path = ",".join(DATA)
    config.data.eval_path = "records/free/furniture,records/free/collections"
    config.data.stretch = 0.3
    config.data.zoom = 0.0
    config.data.shift = 0.0
    config.data.place = 0.3
    config.data.reframe_scale = 0.04
    config.data.reframe_shift = 0.03
    config.data.photo.erode = 1.0
    config.data.photo.dilate = 1.0
    config.data.photo.ragged = 1.0
    config.data.photo.blur = 0.5
    config.data.photo.noise = 0.02
    config.data.photo.jpeg = 0.3
    config.data.photo.white_balance = 0.1
    config.data.photo.exposure = 0.3
    config.model.random_size = 32
    config.model.random_at = "all"
    config.loss.emd_tolerance = 0.1
    config.loss.min_of_n = 8
    config.loss.winner_points = 128
    config.loss.mean_weight = 1.0
    config.optim.learning_rate = 5e-4
    config.optim.ema_decay = 0.999
    config.train.steps = 100_000
    config.train.log_every = 100
    config.train.eval_every = 4_000
    config.train.checkpoint_every = 500
    config.train.images_every = 20_000
    config.train.keep_checkpoints = 3
    return config
