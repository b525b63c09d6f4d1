"""The default data set: a few hundred procedural models, rendered on first use."""

import os
import pathlib
import shutil

from data_gen import job, settings
from data_gen.catalogues.open_catalogue import open_catalogue
from data_gen.catalogues.procedural import FAMILIES
from psgn_jax.data.manifest import load_manifest
from psgn_jax.data.shards import OtherSettingsError

NUM_PER_CATEGORY = 40

NUM_MODELS = NUM_PER_CATEGORY * len(FAMILIES)

CORE_SECONDS = 0.4 * NUM_MODELS
"""Rough seconds of a core for rendering."""

SETTINGS = settings.Settings(views=1, models_per_shard=64)


def build(
    folder: str | os.PathLike[str],
    *,
    models_per_category: int = NUM_PER_CATEGORY,
    options: settings.Settings = SETTINGS,
) -> str:
    """Renders the default data set or completes it, and returns its folder.

    A complete data set does not change, unless models of it failed and now succeed.

    Raises:
      RuntimeError: Mitsuba is missing or does not run, or no model could be rendered.
      ValueError: the folder contains a different, complete data set.
    """
    folder = pathlib.Path(folder)
    source = open_catalogue("procedural", str(models_per_category))
    try:
        progress = job.render_catalogue(source, folder, options)
    except OtherSettingsError:
        # We render an incomplete data set of the other variant of Mitsuba again.
        if load_manifest(folder, allow_incomplete=True).complete:
            raise
        shutil.rmtree(folder)
        progress = job.render_catalogue(source, folder, options)
    if not progress.samples:
        raise RuntimeError(f"the default data set: {job.text_of(progress)}")
    return str(folder)
