"""Models of which only a random part is rendered in the image.

The authors' images show some objects of ShapeNet in this way: faces that point inward, or whose
materials could not be read, are not rendered. The points are those of the whole object. In 8 of the
authors' 1,440 training images, the object covers less than .5 % of the image. In .8 % of the
images, more than a tenth of the points project outside the mask.
"""

import dataclasses
import zlib

import numpy as np

from data_gen.mesh import Model, face_areas, face_normals
from data_gen.settings import Settings

COVERAGE = 0.0003
"""Smallest fraction of the image that the rendered part must cover."""

# Makes these random numbers independent of others with the same seed.
_STREAM = zlib.crc32(b"missing faces")
_RADII = (0.05, 0.8)


def draw(model: Model, settings: Settings, seed: int) -> tuple[Model, Settings]:
    """The part of a model that is rendered, and settings whose checks accept it.

    A fraction `settings.image.missing` of the models loses faces: those on one side (a random
    direction, up in half of the cases), those outside a ball around a point of the surface, or
    those inside such a ball. The radius is log-uniform in [.05, .8].

    Args:
      model: a normalised model.
      settings: the settings of the job.
      seed: seed of the model.

    Returns:
      The model without these faces, with the same vertices, and the settings: `checks.inside` is 0
      and `checks.coverage` at most `COVERAGE`. If nothing is missing, both are returned unchanged.
    """
    rng = np.random.default_rng([_STREAM, seed])
    if rng.random() >= settings.image.missing:
        return model, settings
    kept = _KINDS[rng.integers(len(_KINDS))](model, rng)
    if not kept.any():
        return model, settings
    part = dataclasses.replace(
        model,
        faces=model.faces[kept],
        normals=model.normals[kept],
        uv=model.uv[kept],
        face_material=model.face_material[kept],
    )
    checks = dataclasses.replace(
        settings.checks, inside=0.0, coverage=min(COVERAGE, settings.checks.coverage)
    )
    return part, dataclasses.replace(settings, checks=checks)


def _one_side(model: Model, rng: np.random.Generator) -> np.ndarray:
    direction = rng.normal(size=3)
    if rng.random() < 0.5:
        direction = np.array([0.0, 0.0, 1.0])
    cosine = face_normals(model.vertices, model.faces) @ direction / np.linalg.norm(direction)
    kept: np.ndarray = cosine < rng.uniform(0.0, 0.7)
    return kept


def _inside_ball(model: Model, rng: np.random.Generator) -> np.ndarray:
    areas = face_areas(model.vertices, model.faces)
    centres = model.corners().mean(axis=1)
    chosen = rng.choice(len(areas), p=areas / areas.sum())
    radius = np.exp(rng.uniform(*np.log(_RADII)))
    kept: np.ndarray = np.linalg.norm(centres - centres[chosen], axis=1) <= radius
    return kept


def _outside_ball(model: Model, rng: np.random.Generator) -> np.ndarray:
    return ~_inside_ball(model, rng)


_KINDS = (_one_side, _inside_ball, _inside_ball, _outside_ball)
