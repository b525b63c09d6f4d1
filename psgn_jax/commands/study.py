"""Runs an experiment of the paper: `psgn study NAME --workdir=DIR`.

mean_shape: mean shapes under CD and EMD. networks: vanilla, two-branch and hourglass networks.
branches: the points of each branch. losses: training with the CD and with the EMD. completion: RGB
and RGB-D input. ambiguity: several predictions for one image by Mo2, Mo4, Mo8 and the cVAE.
comparison: predicted volumes and those of 3D-R2N2.

The trainings are ordinary runs in `DIR/CONFIG-SEED`. The same command continues a stopped study.
In the folder of `networks`, `branches` and `losses` use its runs.
"""

import importlib
import pathlib
import sys
from collections.abc import Callable, Sequence

from absl import logging

from psgn_jax.commands.common import keep_compiled
from psgn_jax.config.command_line import Flags
from psgn_jax.config.experiment import ConfigError
from psgn_jax.config.structured import suggestion
from psgn_jax.system.cpu import keep_freed_memory
from psgn_jax.system.files import cache_folder


def _usual(_: str) -> str:
    """`records/authors` if it exists, or the default data set."""
    if pathlib.Path("records/authors").is_dir():
        return "records/authors"
    from psgn_jax.commands.default_data import default_dataset

    logging.info("no folder in --data: training on the default data set")
    return default_dataset()


def _cabinets(workdir: str) -> str:
    """Cabinets with hidden depth, rendered into `workdir/data`."""
    from data_gen import cameras, job, settings
    from data_gen.catalogues import cabinets

    folder = pathlib.Path(workdir) / "data"
    # The camera is at elevation 0 in front of the panel and aims at its middle.
    camera = cameras.CameraSettings(
        image_size=(64, 64), azimuth=(0.0, 0.0), elevation=(0.0, 0.0), aim=(0.45, 0.45)
    )
    options = settings.Settings(views=1, num_points=4096, models_per_shard=64, camera=camera)
    job.render_catalogue(cabinets.cabinets(), folder, options)
    return str(folder)


def _views(_: str) -> str:
    """Five views of each model of the default data set, rendered into the cache folder."""
    from data_gen import default, settings
    from psgn_jax.config.data import DEFAULT_DATA

    folder = cache_folder() / f"{DEFAULT_DATA}-views-5"
    return default.build(folder, settings.Settings(views=5, models_per_shard=64))


STUDIES: dict[str, tuple[str, Callable[[str], str]]] = {
    "mean_shape": ("mean_shape", lambda _: ""),
    "networks": ("architectures", _usual),
    "branches": ("branches", _usual),
    "losses": ("cd_and_emd", _usual),
    "completion": ("completion", _usual),
    "ambiguity": ("ambiguity", _cabinets),
    "comparison": ("comparison", _views),
}
"""Name -> module in `psgn_jax.studies`; function from the study's folder to its default data."""

_OPTIONS = ("seeds", "steps", "only", "eval_data", "measure")


def main(argv: Sequence[str] | None = None) -> int:
    flags = Flags("psgn study NAME", __doc__)
    flags.path("workdir", None, "Folder of the runs and the results; default: runs/NAME.")
    flags.path(
        "data", None, "Folder of records; default: records/authors if it exists, or the default "
        "data set; ambiguity and comparison render their own.",
    )  # fmt: skip
    flags.integer("seeds", 1, "Runs of each configuration.", lower_bound=1)
    flags.integer("steps", 0, "Steps of a training; 0 = default.", lower_bound=0)
    flags.string("only", "", "CONFIG:SEED: train only this run, and measure nothing.")
    flags.path(
        "eval_data", "", "Folders of records for evaluation, also during training; default: --data."
    )
    flags.path("measure", [], "FOLDER:SPLIT,...: measure on these splits too.", "list")
    flags.path(
        "runs", [], "Folders of finished runs to measure instead, separated by commas.", "list"
    )
    return flags.run(_main, argv)


def _main(flags: Flags) -> None:
    values, (name,) = flags.values, flags.arguments
    if name not in STUDIES:
        hint = suggestion(name, STUDIES)
        raise ConfigError(
            f"psgn study {name}: no such study; {hint}expected one of {', '.join(STUDIES)}"
        )
    if values.runs and name not in ("branches", "losses"):
        raise ConfigError(f"--runs={','.join(values.runs)}: accepted by branches and losses")
    if values.measure and name == "ambiguity":
        raise ConfigError(f"--measure={','.join(values.measure)}: not accepted by {name}")
    if values.runs and values.eval_data:
        raise ConfigError(f"--eval_data={values.eval_data}: with --runs, give --data instead")
    module, default_data = STUDIES[name]
    keep_compiled()
    keep_freed_memory()
    from psgn_jax.studies.runner import run
    from psgn_jax.weights.run_folder import load_config

    workdir = values.workdir or f"runs/{name}"
    data = values.data or ""
    own_data = bool(values.runs) and bool(load_config(values.runs[0], "runs").data.path)
    if not data and not own_data:
        try:
            data = default_data(workdir)
        except (RuntimeError, ValueError) as error:
            raise ConfigError(f"without --data, we render the study's data: {error}") from error
    study = importlib.import_module(f"psgn_jax.studies.{module}").STUDY
    options = {option: values[option].value for option in _OPTIONS}
    sys.stdout.write(run(study, workdir, data=data, finished=values.runs, **options))
