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
CORE_SECONDS = 0.4 * NUM_MODELS  # estimated time of rendering, in seconds of a core
SETTINGS = settings.Settings(views=1, models_per_shard=64)


def build(folder: str | os.PathLike[str], options: settings.Settings = SETTINGS) -> str:
    """Renders or completes the default data set, and returns its folder.

    A complete data set changes only if models that failed now succeed.

    Raises:
      RuntimeError: Mitsuba is missing or does not run, or no model could be rendered.
      ValueError: the folder contains another complete data set.
    """
    folder = pathlib.Path(folder)
    source = open_catalogue("procedural", str(NUM_PER_CATEGORY))
    try:
        progress = job.render_catalogue(source, folder, options)
    except OtherSettingsError:
        # An incomplete data set of another variant of Mitsuba: we begin again.
        if load_manifest(folder, allow_incomplete=True).complete:
            raise
        shutil.rmtree(folder)
        progress = job.render_catalogue(source, folder, options)
    if not progress.samples:
        raise RuntimeError(f"the default data set: {job.text_of(progress)}")
    return str(folder)
