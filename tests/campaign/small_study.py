"""A study of two small trainings, for `command_kills`."""

import dataclasses

from campaign import runs
from psgn_jax.config import parse
from psgn_jax.experiments import common

NAMES = ("zero", "one")


def configs(options):
    """Two seeds, which share compiled programs."""
    for seed, name in enumerate(NAMES):
        config = parse(runs.debug_configuration(options.data, steps=16))
        yield name, dataclasses.replace(config, seed=seed)


def measure(options):
    """Mean Chamfer distance of both."""
    both = {name: common.measure(options.workdir / name) for name in NAMES}
    means = {k: float(v.evaluation.metrics["cd_sq_radius2"].mean()) for k, v in both.items()}
    return {"means": means}, None


def table(numbers):
    """One row for each training."""
    return [[["run", "CD"], *([k, common.number("CD", v)] for k, v in numbers["means"].items())]]


STUDY = common.Study(
    "small", configs, measure, table, lambda *_: {}, options={"data": None, "steps": 0}
)

if __name__ == "__main__":
    STUDY.main()
