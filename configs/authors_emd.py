r"""The full two-branch network on the authors' batches, trained with the EMD.

Command: psgn convert authors SRC records/authors
         python -m psgn_jax.main --config=configs/authors_emd.py --workdir=runs/authors_emd
Hardware: a GPU; on two CPU cores a step takes one to two seconds (docs/benchmarks.md).
Expect: a lower EMD and a higher Chamfer distance than `authors.py`; not measured.

The recipe is that of `authors.py`. The EMD compares clouds of equal size, here 1,024 points.

On two CPU cores, train the half-size network, at .25 to .5 s per step (docs/benchmarks.md). After
600 steps its emd_radius is .156 and its cd_sq_radius2 .0179; 3,200 steps with the CD give .309 and
.0105:
    python -m psgn_jax.main --config=configs/authors_small.py --workdir=runs/authors_small_emd \
    --config.loss.name=emd_mean --config.data.num_points=1024
"""

import ml_collections

from psgn_jax.config import files


def get_config() -> ml_collections.ConfigDict:
    config = files.load("authors")
    config.data.num_points = 1024
    config.loss.name = "emd_mean"
    return config
