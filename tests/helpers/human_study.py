"""A table of five boxes as a record, for tests of the study of human ability."""

import numpy as np

from helpers import drawn_solids
from psgn_jax.data import camera, schema

TURN = 25  # direction of the table, degrees

# Centre and extents of each box, along the axes of the table.
TOP = ((0, 0, 0.66), (0.8, 1.2, 0.08))
LEG = ((0.34, 0.52, 0.31), (0.08, 0.08, 0.62))
LEGS = [((x * LEG[0][0], y * LEG[0][1], LEG[0][2]), LEG[1]) for x in (1, -1) for y in (1, -1)]


def corners(middle, size):
    """Corners [8, 3] of a box."""
    signs = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3)
    return signs * size + np.array(middle)


def turn(points):
    """Points in the frame of the record."""
    cosine, sine = np.cos(np.deg2rad(TURN)), np.sin(np.deg2rad(TURN))
    return points @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])


def table_points(count, seed=0):
    """Points on the table, except where the legs meet the top."""
    rng = np.random.default_rng(seed)
    boxes = [TOP, *LEGS]
    areas = [2 * (a * b + b * c + a * c) for _, (a, b, c) in boxes]
    numbers = np.ceil(1.1 * count * np.array(areas) / sum(areas)).astype(int)
    drawn = [drawn_solids.box(np.array(size) / 2) for _, size in boxes]
    parts = zip(drawn, numbers, boxes, strict=True)
    points = np.concatenate([draw.sample(rng, n) + middle for draw, n, (middle, _) in parts])
    bottom = TOP[0][2] - TOP[1][2] / 2
    under = np.abs(points[:, 2] - bottom) < 1e-9
    near = np.abs(np.abs(points[:, :2]) - LEG[0][:2]).max(axis=1) < LEG[1][0] / 2
    return turn(rng.permutation(points[~(under & near)])[:count]).astype(np.float32)


def table_sample(size=(96, 128)):
    """The table in front of the authors' camera."""
    intrinsics, extrinsics = camera.default_camera(size)
    pixels, _ = camera.project(table_points(60_000, seed=1), intrinsics, extrinsics)
    mask = np.zeros(size, np.bool_)
    columns, rows = np.floor(pixels).astype(int).T
    mask[rows, columns] = True
    image = np.full((*size, 3), schema.BACKGROUND_GREY, np.uint8)
    image[mask] = (150, 105, 70)
    names = {"category": "table", "model_id": "known", "source": "test"}
    return schema.Sample(image, mask, table_points(8192), intrinsics, extrinsics, **names)
