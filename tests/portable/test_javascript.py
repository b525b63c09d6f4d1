"""Framing and fit in JavaScript give the same pixels and points as in Python.

`web/page/test_browser.py` compares whole predictions.
"""

import jax
import numpy as np
import pytest
from helpers import drawn_solids, javascript

from psgn_jax.data import camera, framing
from psgn_jax.portable import folder
from psgn_jax.prediction import silhouette

pytestmark = pytest.mark.skipif(javascript.NODE is None, reason="no node")


def run_node(body, module="framing", **values):
    return javascript.node(body, {"framing": folder.TEMPLATES / f"{module}.js"}, **values)


def about(image_size=(96, 128)):
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
    results = run_node(body, cases=given, about=about(size))
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


@pytest.mark.parametrize("placed", [False, True])
@pytest.mark.parametrize("image_size", [(96, 128), (192, 256)])
def test_a_cloud_is_fitted_to_the_mask(placed, image_size):
    rng = np.random.default_rng(2)
    points = rng.uniform((-0.3, -0.4, 0), (0.4, 0.4, 0.5), (300, 3)).astype(np.float32)
    mask = np.zeros(image_size, bool)
    height, width = image_size
    mask[height // 3 : 3 * height // 4, width // 3 : 2 * width // 3] = True
    mask &= rng.random(mask.shape) < 0.9
    body = "return framing.fit([input.points], input.mask, input.find, input.about);"
    given = {"points": points, "mask": mask, "find": placed, "about": about(image_size)}
    own = run_node(body, "silhouette", **given)
    fitted = jax.jit(silhouette.fit, static_argnames="placed")
    expected = fitted(points[None], mask, *camera.default_camera(mask.shape), placed=placed)
    extrinsics = own["camera"]["extrinsics"]
    np.testing.assert_allclose(extrinsics, expected.extrinsics, atol=1e-4)
    gaps = np.abs(np.reshape(own["clouds"][0], (-1, 3)) - expected.points[0]).max(axis=1)
    assert (gaps < 1e-3).mean() > 0.99  # points on the border of a pixel may go another way
    assert (np.abs(points - expected.points[0]).max(axis=1) > 0.02).mean() > 0.1
