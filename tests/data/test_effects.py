import dataclasses

import numpy as np
import pytest
from helpers import drawn_solids as solids

from psgn_jax.config.data import DataConfig, PhotoEffects
from psgn_jax.data import framing, loader
from psgn_jax.data.effects import LEAST_LEFT, disturb

EFFECTS = {
    "erode": 3.0, "dilate": 3.0, "ragged": 2.5, "occluders": 1.0, "blur": 2.0, "noise": 0.1,
    "jpeg": 1.0, "white_balance": 0.3, "exposure": 1.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def sample():
    rng = np.random.default_rng(1)
    return solids.draw(solids.RANDOM["box"](rng), rng, image_size=(96, 128))


def disturbed(sample, seed=0, **effects):
    rng = np.random.default_rng(seed)
    return disturb(sample.image, sample.mask, rng, PhotoEffects(**effects))


@pytest.mark.parametrize("name", EFFECTS)
def test_each_effect_happens_and_repeats(sample, name):
    changed = shown = 0
    for seed in range(8):
        (image, mask), again = (disturbed(sample, seed, **{name: EFFECTS[name]}) for _ in range(2))
        np.testing.assert_array_equal(image, again[0])
        np.testing.assert_array_equal(mask, again[1])
        assert (image[~mask] == 191).all()
        assert mask.sum() >= LEAST_LEFT * sample.mask.sum()
        both, ring = mask & sample.mask, mask & ~sample.mask
        shown += bool(ring.any()) and (image[ring] != 191).any()
        if name in ("erode", "dilate", "ragged"):
            changed += (mask != sample.mask).any()
            np.testing.assert_array_equal(image[both], sample.image[both])
        else:
            changed += (image[both] != sample.image[both]).any() or (mask != sample.mask).any()
            if name != "occluders":
                np.testing.assert_array_equal(mask, sample.mask)
    assert changed >= 4
    assert shown >= 4 or name != "dilate"  # a grown mask shows a background


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
