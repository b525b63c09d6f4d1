"""Framing in JavaScript gives the same pixels as in Python.

`web/browser/test_app.py` compares whole predictions.
"""

import numpy as np
import pytest
from helpers import drawn_solids, javascript

from psgn_jax.data import camera, framing
from psgn_jax.portable import folder

pytestmark = pytest.mark.skipif(javascript.NODE is None, reason="no node")


def about(image_size):
    intrinsics, extrinsics = camera.default_camera(image_size)
    return {
        **folder.RULES,
        "view_size": camera.VIEW_SIZE,
        "image_size": image_size,
        "background": 191,
        "camera": {"intrinsics": intrinsics.tolist(), "extrinsics": extrinsics.tolist()},
    }


def photos(rng):
    """Photos and masks: noise in many sizes; masks with holes, at borders and of a few pixels."""
    for height, width in ((480, 640), (97, 333), (700, 200), (60, 80), (31, 29), (192, 256)):
        for _ in range(2):
            image = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
            mask = np.zeros((height, width), bool)
            for _ in range(3):
                rows, columns = np.sort(rng.integers(0, (height, width), (2, 2)), axis=0).T
                mask[rows[0] : rows[1] + 6, columns[0] : columns[1] + 9] = True
            mask &= rng.random(mask.shape) < rng.choice([0.8, 0.98, 1])
            yield image, mask
    framed = next(iter(drawn_solids.samples(1, seed=0, image_size=(192, 256))))
    yield framed.image, framed.mask
    yield framed.image.repeat(2, 0).repeat(2, 1), framed.mask.repeat(2, 0).repeat(2, 1)


@pytest.mark.parametrize("size", [(192, 256), (96, 128)])
def test_views_are_the_same_to_the_last_pixel(size):
    cases = list(photos(np.random.default_rng(0)))
    given = [
        {"photo": {"rgb": image, "width": image.shape[1], "height": image.shape[0]}, "mask": mask}
        for image, mask in cases
    ]
    body = "return input.cases.map(c => framing.place(c.photo, c.mask, input.about));"
    modules = {"framing": folder.TEMPLATES / "framing.js"}
    results = javascript.node(body, modules, cases=given, about=about(size))
    placed = set()
    for (image, mask), result in zip(cases, results, strict=True):
        view = framing.place(image, mask, size, move=not framing.is_framed(image))
        assert result["placed"] == view.placed
        np.testing.assert_array_equal(np.reshape(result["rgb"], (*size, 3)), view.image)
        np.testing.assert_array_equal(np.reshape(result["mask"], size), view.mask)
        scale = np.diag(view.to_view)[:2]
        np.testing.assert_allclose(result["toView"]["scale"], scale, rtol=1e-12)
        np.testing.assert_allclose(result["toView"]["shift"], view.to_view[:2, 2], rtol=1e-9)
        placed.add(view.placed)
    assert placed == {True, False}
