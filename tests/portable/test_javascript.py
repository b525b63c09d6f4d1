"""Framing, normal form and colours in JavaScript give the same pixels and points as in Python."""

import jax
import numpy as np
import pytest
from helpers import drawn_solids, javascript
from PIL import Image

from psgn_jax.data import camera, framing
from psgn_jax.losses.emd import emd_exact
from psgn_jax.portable import folder
from psgn_jax.prediction import draws as own_draws
from psgn_jax.prediction import silhouette
from psgn_jax.prediction.cloud import colours_from_view, find_outliers
from psgn_jax.prediction.refine import mean_of_matched

MODULES = {name: folder.TEMPLATES / f"{name}.js" for name in ("draws", "framing", "resample")}
pytestmark = pytest.mark.skipif(javascript.NODE is None, reason="no node")


def run_node(body, **values):
    return javascript.node(body, MODULES, **values)


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


def test_draws_have_the_same_order_and_spread():
    clouds = np.random.default_rng(0).normal(size=(7, 300, 3)).astype(np.float32)
    body = """
        const order = draws.ranked(input.clouds, 3, input.compared);
        return [order, await draws.spread(order, 2, async () => {})];"""
    compared = own_draws.compared_points(300).tolist()
    order, spread = run_node(body, clouds=list(clouds.reshape(7, -1)), compared=compared)
    expected = clouds[np.asarray(own_draws.ranked(clouds, 3))]
    np.testing.assert_array_equal(np.reshape(order, expected.shape), expected)
    # The bijections are optimal up to 5 % here and 1 % there.
    np.testing.assert_allclose(np.mean(spread[0]), own_draws.spread(expected)[0].mean(), rtol=0.05)
    assert sorted(spread[1]) == sorted(spread[0])


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


def test_images_are_resized_as_by_pillow(rng):
    image = rng.integers(0, 256, (70, 90, 3), dtype=np.uint8)
    body = """
return input.sizes.map(([width, height, box]) =>
  resample.resize(input.image, 90, 70, 3, width, height, box, resample.LANCZOS));
"""
    sizes = [(32, 32, (0, 0, 90, 70)), (120, 100, (11, 3, 60, 65)), (20, 90, (5, 0, 90, 33))]
    results = run_node(body, image=image, sizes=sizes)
    for (width, height, box), own in zip(sizes, results, strict=True):
        expected = Image.fromarray(image).resize((width, height), Image.Resampling.LANCZOS, box)
        np.testing.assert_array_equal(np.reshape(own, (height, width, 3)), expected)


def test_normal_form_and_colours():
    sample = next(iter(drawn_solids.samples(1, seed=4, image_size=(192, 256))))
    points = sample.points[:700].astype(np.float32)
    points[[3, 90]] += 2
    view = framing.place(sample.image, sample.mask, (96, 128), move=False)
    body = """
const view = { rgb: input.image, mask: input.mask };
const outlier = framing.findOutliers(input.points);
const colours = framing.coloursFromView(input.points, view, input.about);
return [framing.normalForm(input.points, outlier), outlier, colours];
"""
    given = {"points": points, "image": view.image, "mask": view.mask, "about": about()}
    normal, outlier, colours = run_node(body, **given)
    np.testing.assert_array_equal(outlier, find_outliers(points))
    assert sum(outlier) == 2
    scale, shift = framing.normal_form(points[~np.array(outlier)])
    np.testing.assert_allclose(normal["scale"], scale, rtol=1e-7)
    np.testing.assert_allclose(normal["shift"], shift, atol=1e-7)
    normalised = ((points - shift) / scale).astype(np.float32)
    np.testing.assert_allclose(np.reshape(normal["points"], (-1, 3)), normalised, atol=1e-6)
    expected, seen = colours_from_view(points, view)
    assert 0.2 < seen.mean() < 0.9
    own = np.reshape(colours, (-1, 3))
    assert (own != expected).any(axis=1).mean() < 0.02  # points on a pixel's border


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
    own = javascript.node(body, {"framing": folder.TEMPLATES / "silhouette.js"}, **given)
    fitted = jax.jit(silhouette.fit, static_argnames="placed")
    expected = fitted(points[None], mask, *camera.default_camera(mask.shape), placed=placed)
    extrinsics = own["camera"]["extrinsics"]
    np.testing.assert_allclose(extrinsics, expected.extrinsics, atol=1e-4)
    gaps = np.abs(np.reshape(own["clouds"][0], (-1, 3)) - expected.points[0]).max(axis=1)
    assert (gaps < 1e-3).mean() > 0.99  # points on the border of a pixel may go another way
    assert (np.abs(points - expected.points[0]).max(axis=1) > 0.02).mean() > 0.1


def test_the_mean_with_the_mirror_image_is_of_optimally_matched_points():
    rng = np.random.default_rng(3)
    image = rng.integers(0, 255, (5, 7, 3), np.uint8)
    points, other = rng.normal(size=(2, 200, 3)).astype(np.float32)
    body = """
return [framing.mirrored(input.image, 7, 3), framing.meanWithMirror(input.points, input.other)];
"""
    flipped, mean = run_node(body, image=image, points=points, other=other)
    np.testing.assert_array_equal(np.reshape(flipped, image.shape), image[:, ::-1])
    back = other * np.float32([1, -1, 1])
    expected = (points + back[emd_exact(points, back).index]) / 2
    np.testing.assert_allclose(np.reshape(mean, (-1, 3)), expected, atol=1e-6)
    assert np.abs(jax.jit(mean_of_matched)(points, back) - expected).max(axis=1).mean() < 0.01
