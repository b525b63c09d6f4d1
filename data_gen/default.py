"""The default data set: a few hundred procedural models, made on first use by the ordinary job."""

import os
import pathlib
import shutil

from data_gen import job, settings
from data_gen.catalogues.by_name import open_catalogue
from data_gen.mitsuba_setup import has_mitsuba
from psgn_jax.data.manifest import load_manifest

NUM_PER_CATEGORY = 40
"""Models of each of the 13 categories, one view each: 520 images."""

NAME = f"procedural-2-{NUM_PER_CATEGORY}"
"""Folder of the data set. The first number is its version: it goes up with every change of what a
model or a picture looks like, so that nobody trains on a mixture."""

SETTINGS = settings.Settings(views=1, models_per_shard=64)
"""The authors' camera and size, one view of each model."""


def can_build() -> bool:
    """Whether what rendering needs is installed."""
    return has_mitsuba()


def build(
    folder: str | os.PathLike[str],
    *,
    models_per_category: int = NUM_PER_CATEGORY,
    options: settings.Settings = SETTINGS,
) -> str:
    """Makes the default data set, or completes it; a complete one is left as it is.

    Progress goes to absl's log. Where LLVM is found it is used; the data set differs by rounding.

    Args:
      folder: of the data set; one that was begun by another renderer is begun anew.
      models_per_category: how many.
      options: all settings.

    Returns:
      the folder, a complete data set of records.

    Raises:
      RuntimeError: Mitsuba is missing or does not run, or no model could be rendered.
      ValueError: the folder holds something else, complete.
    """
    folder = pathlib.Path(folder)
    source = open_catalogue("procedural", str(models_per_category))
    try:
        summary = job.render_catalogue(source, folder, options)
    except job.OtherSettingsError:
        # Begun before LLVM came or went, and not completed: nothing of worth is lost.
        if load_manifest(folder, allow_incomplete=True).complete:
            raise
        shutil.rmtree(folder)
        summary = job.render_catalogue(source, folder, options)
    if not summary.samples:
        raise RuntimeError(f"the default data set: {summary.text()}")
    return str(folder)
