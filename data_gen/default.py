"""The default data set: a few hundred procedural models, made on first use.

`build` runs the ordinary job. Measured on two cores without LLVM, see `NUM_PER_CATEGORY`.
"""

import os
import pathlib

from data_gen import catalogues, job, settings, worker

NUM_PER_CATEGORY = 24
"""Models of each of the 13 categories, one view each: 312 images.

Scalar rendering takes 0.2 s of a processor for each, so two cores take well under a minute; this
leaves room for slower and busier machines within two minutes."""

SETTINGS = settings.Settings(views=1, models_per_shard=64)
"""The authors' camera and size, one view of each model."""


def can_build() -> bool:
    """Whether what rendering needs is installed."""
    return worker.has_mitsuba()


def build(folder: str | os.PathLike[str], *, models_per_category: int = NUM_PER_CATEGORY) -> str:
    """Makes the default data set, or completes it; a complete one is left as it is.

    Progress goes to absl's log. Where LLVM is found it is used; the data set differs by rounding.

    Args:
      folder: of the data set.
      models_per_category: how many.

    Returns:
      the folder, a complete data set of `psgn_jax.data.records`.

    Raises:
      RuntimeError: Mitsuba is missing or does not run, or no model could be rendered.
      ValueError: the folder holds something else.
    """
    folder = pathlib.Path(folder)
    source = catalogues.open("procedural", str(models_per_category))
    summary = job.render_catalogue(source, folder, SETTINGS)
    if not summary.samples:
        raise RuntimeError(f"the default data set: {summary.text()}")
    return str(folder)
