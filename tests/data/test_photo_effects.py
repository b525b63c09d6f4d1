"""Photo effects: enabled effects change the image, disabled effects do not."""

import dataclasses

import numpy as np
import pytest
from helpers import drawn_solids as solids

from psgn_jax.config.data import DataConfig, PhotoEffects
from psgn_jax.data import framing, loader, photo_effects

EFFECTS = {
    "erode": 3.0,
    "dilate": 3.0,
    "ragged": 2.5,
    "occluders": 1.0,
    "blur": 2.0,
    "noise": 0.1,
    "jpeg": 1.0,
    "white_balance": 0.3,
    "exposure": 1.0,
}
OF_MASK = ("erode", "dilate", "ragged")


@pytest.fixture(scope="module")
def sample():
    rng = np.random.default_rng(1)
    return solids.draw(solids.random_solid("box", rng), rng, image_size=(96, 128))


def disturbed(sample, seed=0, **effects):
    rng = np.random.default_rng(seed)
    return photo_effects.disturb(sample.image, sample.mask, rng, PhotoEffects(**effects))


@pytest.mark.parametrize("name", EFFECTS)
def test_each_effect_happens_and_repeats(sample, name):
    changed = 0
    for seed in range(8):
        (image, mask), again = (disturbed(sample, seed, **{name: EFFECTS[name]}) for _ in range(2))
        np.testing.assert_array_equal(image, again[0])
        np.testing.assert_array_equal(mask, again[1])
        assert (image[~mask] == 191).all()
        assert mask.sum() >= photo_effects.LEAST_LEFT * sample.mask.sum()
        both = mask & sample.mask
        if name in OF_MASK:
            changed += (mask != sample.mask).any()
            np.testing.assert_array_equal(image[both], sample.image[both])
        else:
            changed += (image[both] != sample.image[both]).any() or (mask != sample.mask).any()
            if name != "occluders":
                np.testing.assert_array_equal(mask, sample.mask)
    assert changed >= 4


def test_the_edge_moves_by_so_many_pixels():
    mask = np.zeros((192, 256), bool)
    mask[60:120, 80:180] = True
    rng = np.random.default_rng(0)
    for length in (-3, -1, 2, 4):
        moved = photo_effects._move_edge(mask, length, 0.0, 8, rng)
        assert framing.box_of(moved) == (60 - length, 120 + length, 80 - length, 180 + length)
    # Where the image border cuts the object off, the mask is not eroded.
    mask[:, 0:90] = True
    assert photo_effects._move_edge(mask, -3, 0.0, 8, rng)[:, :80].all()


def test_switching_one_effect_on_changes_no_draw_of_another(sample):
    _, alone = disturbed(sample, 3, erode=3.0)
    _, together = disturbed(sample, 3, erode=3.0, blur=2.0, exposure=1.0)
    np.testing.assert_array_equal(alone, together)


def test_a_grown_mask_shows_a_background(sample):
    shown = 0
    for seed in range(6):
        image, mask = disturbed(sample, seed, dilate=4.0)
        ring = mask & ~sample.mask
        shown += bool(ring.any()) and (image[ring] != 191).any()
    assert shown >= 4


def test_an_evaluation_places_every_sample_and_its_points(dataset):
    cfg = DataConfig(path=str(dataset), image_size=(48, 64), num_eval_points=150)
    options = {"split": "validation", "batch_size": 11, "visible_tolerance": 0.03}
    (kept,) = loader.eval_batches(cfg, **options)
    (placed,) = loader.eval_batches(dataclasses.replace(cfg, eval_frame="place"), **options)
    np.testing.assert_array_equal(placed["visible"], kept["visible"])
    np.testing.assert_array_equal(placed["extrinsics"], kept["extrinsics"])
    for row in range(11):
        move = framing.rule_move_within(kept["mask"][row])
        spread = np.ptp(placed["points"][row], axis=0) / np.ptp(kept["points"][row], axis=0)
        np.testing.assert_allclose(spread, move.scale, rtol=1e-4)
        assert abs(np.log(framing.rule_move_within(placed["mask"][row]).scale)) < 0.1


def test_only_the_surroundings_of_the_object_matter():
    mask = np.zeros((96, 128), bool)
    mask[30:60, 40:90] = True
    effects = PhotoEffects(
        erode=2, dilate=2, ragged=2, blur=1, noise=0.05, jpeg=0.5, exposure=0.3, white_balance=0.1
    )
    image = np.where(mask[..., None], np.uint8(80), np.uint8(191)).repeat(3, axis=2)
    far = image.copy()
    far[:10] = far[-10:] = far[:, :20] = 7
    for seed in range(10):
        one, two = (
            photo_effects.disturb(x, mask, np.random.default_rng(seed), effects)
            for x in (image, far)
        )
        np.testing.assert_array_equal(one[0], two[0])
        np.testing.assert_array_equal(one[1], two[1])
