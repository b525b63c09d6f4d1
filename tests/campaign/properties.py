"""Properties of codecs, framing, cameras and losses, tested with Hypothesis (extra `dev`)."""

import importlib.util
import pathlib
import random
import time
from collections.abc import Callable

import numpy as np

from campaign.frame import Finding
from psgn_jax.data import camera, framing, schema
from psgn_jax.data.codec import decode, decode_stored, depth_codes_of, encode, lattice_of

SIZE = (24, 32)


def part(rng: random.Random, deadline: float, folder: pathlib.Path) -> list[Finding]:
    """Tests each property with new examples until the time is over."""
    if importlib.util.find_spec("hypothesis") is None:
        return [Finding("properties: hypothesis is installed", 1, 0, ["pip install hypothesis"])]
    import hypothesis
    from hypothesis import strategies

    findings = []
    properties = (codec, lattice, depth, projection, moves, normal_form, chamfer)
    for number, check in enumerate(properties):
        finding = Finding(f"property {check.__name__}: {(check.__doc__ or '').splitlines()[0]}")
        end = time.monotonic() + max(deadline - time.monotonic(), 0) / (len(properties) - number)
        while not finding.tried or time.monotonic() < end:
            counted, tried = _counted(check)
            test: Callable[[], None] = hypothesis.given(strategies.integers(0, 2**63))(counted)
            test = hypothesis.settings(max_examples=20, database=None, deadline=None)(test)
            test = hypothesis.seed(rng.randrange(2**32))(test)
            try:
                test()
            except Exception as error:
                finding.add(f"{type(error).__name__}: {error}")
                break
            finding.tried += tried[0]
            finding.held += tried[0]
        findings.append(finding)
    return findings


def _counted(check: Callable[[np.random.Generator], None]) -> tuple[Callable, list[int]]:
    """`check` as a function of a seed, and a counter of its calls."""
    tried = [0]

    def counted(seed: int) -> None:
        tried[0] += 1
        check(np.random.default_rng(seed))

    return counted, tried


def _sample(rng: np.random.Generator) -> schema.Sample:
    mask = rng.random(SIZE) < rng.random()
    points = rng.normal(size=(int(rng.integers(1, 200)), 3)) * 10 ** rng.uniform(-3, 2, 3)
    normals = rng.normal(size=points.shape)
    intrinsics, extrinsics = camera.default_camera(SIZE)
    return schema.Sample(
        image=rng.integers(0, 256, (*SIZE, 3), np.uint8),
        mask=mask,
        depth=np.where(mask, rng.uniform(0.1, 10 ** rng.uniform(0, 3), SIZE), 0).astype(np.float32),
        points=points.astype(np.float32),
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        occupancy=rng.random((32, 32, 32)) < rng.random(),
        intrinsics=intrinsics,
        extrinsics=extrinsics,
        category=rng.choice(["", "chair", "Stühle\n"]).item(),
        model_id=str(rng.integers(1000)),
        view=int(rng.integers(0, 2**31)),
        source="campaign",
    )


def codec(rng: np.random.Generator) -> None:
    """A record gives back what was encoded, exactly or to the stated error."""
    sample = _sample(rng)
    back = decode(encode(sample, normal_bits=16))
    schema.validate(back)
    for field in ("image", "mask", "occupancy", "intrinsics", "extrinsics"):
        np.testing.assert_array_equal(getattr(back, field), getattr(sample, field))
    for field in ("category", "model_id", "view", "source"):
        assert getattr(back, field) == getattr(sample, field)
    top = np.ptp(sample.points, axis=0).astype(np.float64) / 4095
    near = np.abs(back.points[:, None] - sample.points).max(axis=2)
    # Every point is within half a step of a stored point on each axis, up to float32 rounding.
    limit = top.max() / 2 * 1.001 + 1e-5 * (1 + np.abs(sample.points).max())
    assert near.min(axis=1).max() <= limit
    assert near.min(axis=0).max() <= limit
    assert encode(back, points=decode_stored(encode(sample, normal_bits=16)).points)


def lattice(rng: np.random.Generator) -> None:
    """The error of points on a lattice is at most half a step on each axis."""
    points = rng.normal(size=(int(rng.integers(1, 300)), 3)) * 10 ** rng.uniform(-6, 3, 3)
    bits = int(rng.integers(1, 17))
    step = np.ptp(points, axis=0) / (2**bits - 1)
    error = np.abs(lattice_of(points, bits).points() - points)
    assert (error <= step / 2 * 1.001 + 1e-5 * (1e-9 + np.abs(points).max(axis=0))).all()


def depth(rng: np.random.Generator) -> None:
    """The error of depth is at most 1/131070 of its range; pixels without depth are kept."""
    values = np.where(rng.random(SIZE) < 0.5, rng.uniform(0.01, 50, SIZE), 0).astype(np.float32)
    back = depth_codes_of(values).depth()
    np.testing.assert_array_equal(back > 0, values > 0)
    there = values[values > 0]
    limit = (np.ptp(there) if len(there) else 0) / 131070
    assert np.abs(back - values).max() <= limit * 1.01 + 1e-6 * max(values.max(), 1)


def projection(rng: np.random.Generator) -> None:
    """Resizing an image changes only the intrinsics: projected pixels are scaled like the image."""
    intrinsics, extrinsics = camera.default_camera(SIZE)
    points = rng.uniform(-1, 1, (20, 3)).astype(np.float32)
    new = tuple(int(n) for n in rng.integers(8, 300, 2))
    scaled = camera.scale_intrinsics(intrinsics, SIZE, new)
    one, depths = camera.project(points, intrinsics, extrinsics)
    two, again = camera.project(points, scaled, extrinsics)
    np.testing.assert_array_equal(depths, again)
    np.testing.assert_allclose(
        two, one * [new[1] / SIZE[1], new[0] / SIZE[0]], rtol=1e-4, atol=1e-3
    )


def moves(rng: np.random.Generator) -> None:
    """A move and compositions of moves agree with matrices; a move kept inside crops nothing."""
    one, two = (
        framing.Move(rng.uniform(0.3, 3), *(float(x) for x in rng.uniform(-50, 50, 2)))
        for _ in range(2)
    )
    np.testing.assert_allclose(
        one.then(two).matrix(), two.matrix() @ one.matrix(), rtol=1e-9, atol=1e-9
    )
    mask = np.zeros(SIZE, np.bool_)
    top, left = int(rng.integers(0, 16)), int(rng.integers(0, 24))
    mask[top : top + int(rng.integers(1, 8)), left : left + int(rng.integers(1, 8))] = True
    kept = framing.keep_inside(one, mask)
    box = framing.box_of(mask)
    rows = kept.scale * np.array(box[:2]) + kept.down
    columns = kept.scale * np.array(box[2:]) + kept.right
    assert rows.min() >= -1e-6
    assert columns.min() >= -1e-6
    assert rows.max() <= SIZE[0] + 1e-6
    assert columns.max() <= SIZE[1] + 1e-6


def normal_form(rng: np.random.Generator) -> None:
    """Clouds in normal form stand on the ground with radius 1 and can be converted back."""
    points = rng.normal(size=(2, 30, 3)) * 10 ** rng.uniform(-3, 3) + rng.normal(size=3)
    scale, shift = framing.normal_form(points)
    normal = (points - shift) / scale
    assert abs(normal[..., 2].min()) < 1e-6
    assert abs(np.linalg.norm(normal, axis=-1).max() - 1) < 1e-6


def chamfer(rng: np.random.Generator) -> None:
    """The Chamfer distance is that of the definition, symmetric, and 0 of a cloud with itself."""
    from psgn_jax.losses.chamfer import chamfer_sq_mean

    one, two = (rng.normal(size=(24, 3)).astype(np.float32) for _ in range(2))
    square = ((one[:, None].astype(np.float64) - two) ** 2).sum(axis=2)
    expected = square.min(axis=1).mean() + square.min(axis=0).mean()
    found = float(chamfer_sq_mean(one, two))
    assert abs(found - expected) <= 1e-5 * (1 + expected)
    assert abs(float(chamfer_sq_mean(two, one)) - found) <= 1e-6 * (1 + expected)
    assert float(chamfer_sq_mean(one, one)) <= 1e-6
