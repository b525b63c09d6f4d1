"""The default data set: a few hundred procedural models, rendered on first use."""

import os
import pathlib
import shutil

from data_gen import job, settings
from data_gen.catalogues.open_catalogue import open_catalogue
from data_gen.catalogues.procedural import FAMILIES
from data_gen.engine import has_mitsuba
from psgn_jax.data.manifest import load_manifest
from psgn_jax.data.shards import OtherSettingsError

NUM_PER_CATEGORY = 40
"""Number of models of each of the 13 categories, with one view each: 520 images."""

NUM_MODELS = NUM_PER_CATEGORY * len(FAMILIES)

CORE_SECONDS = 0.4 * NUM_MODELS
"""Rough seconds of a core for rendering: 520 models take a minute or two on two cores."""

NAME = f"procedural-3-{NUM_PER_CATEGORY}"
"""Name of the data set's folder. The first number is a version. Raise it with every change of
models or images, so that a data set never mixes versions."""

SETTINGS = settings.Settings(views=1, models_per_shard=64)
"""Settings: the authors' camera and image size, one view of each model."""


def can_build() -> bool:
    """Whether the packages for rendering are installed."""
    return has_mitsuba()


def build(
    folder: str | os.PathLike[str],
    *,
    models_per_category: int = NUM_PER_CATEGORY,
    options: settings.Settings = SETTINGS,
) -> str:
    """Renders the default data set or completes it, and returns its folder.

    A complete data set does not change. If another variant of the renderer began an incomplete one,
    we render it again from the start. We use LLVM if it is available; without it, the images differ
    by rounding.

    Raises:
      RuntimeError: Mitsuba is missing or does not run, or no model could be rendered.
      ValueError: the folder contains a different, complete data set.
    """
    folder = pathlib.Path(folder)
    source = open_catalogue("procedural", str(models_per_category))
    try:
        progress = job.render_catalogue(source, folder, options)
    except OtherSettingsError:
        # An incomplete data set of the other variant of the renderer is deleted.
        if load_manifest(folder, allow_incomplete=True).complete:
            raise
        shutil.rmtree(folder)
        progress = job.render_catalogue(source, folder, options)
    if not progress.samples:
        raise RuntimeError(f"the default data set: {job.text_of(progress)}")
    return str(folder)
