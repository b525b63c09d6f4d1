"""A study of two small trainings, for `command_kills`."""

import dataclasses

from campaign import runs
from psgn_jax.config import parse
from psgn_jax.experiments import common


def configs(options):
    """Two learning rates."""
    for name, rate in (("slow", 1e-4), ("fast", 1e-3)):
        config = parse(runs.debug_configuration(options.data, steps=16))
        yield (
            name,
            dataclasses.replace(
                config, optim=dataclasses.replace(config.optim, learning_rate=rate)
            ),
        )


def measure(options):
    """Mean Chamfer distance of both."""
    both = {name: common.measure(options.workdir / name) for name in ("slow", "fast")}
    means = {k: float(v.evaluation.metrics["cd_sq_radius2"].mean()) for k, v in both.items()}
    return {"means": means}, None


def table(numbers):
    """One row for each."""
    return [[["run", "CD"], *([k, common.number("CD", v)] for k, v in numbers["means"].items())]]


STUDY = common.Study(
    "small", configs, measure, table, lambda *_: {}, options={"data": None, "steps": 0}
)

if __name__ == "__main__":
    STUDY.main()
