import numpy as np

from psgn_jax.data import camera, visibility


def slow(points, depth, intrinsics, extrinsics, tolerance):
    """The definition without optimisation: every point is compared with every pixel."""
    seen = []
    for row, column in np.argwhere(depth > 0):
        ray = np.linalg.inv(intrinsics.astype(float)) @ [column + 0.5, row + 0.5, 1]
        rotation, shift = extrinsics[:, :3].astype(float), extrinsics[:, 3].astype(float)
        seen.append(rotation.T @ (ray * float(depth[row, column]) - shift))
    gaps = (np.linalg.norm(point.astype(float) - seen, axis=1).min() for point in points)
    return np.array([gap <= tolerance for gap in gaps])


def test_equals_the_slow_rule_for_any_camera_and_scattered_depth(rng):
    intrinsics = np.array([[80, 3, 30], [0, 60, 11], [0, 0, 1]], np.float32)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    extrinsics = np.concatenate([rotation, [[0.1], [-0.2], [1.4]]], axis=1).astype(np.float32)
    depth = np.where(rng.random((24, 40)) < 0.3, rng.uniform(0.6, 2, (24, 40)), 0)
    depth[3, 4:6] = [-1, 0.2]
    # Points near measured pixels, anywhere, behind the camera, outside the image.
    near = camera.back_project(depth, intrinsics, extrinsics)
    near = near + rng.normal(0, 0.03, near.shape)
    points = np.concatenate([near, rng.uniform(-3, 3, (300, 3))]).astype(np.float32)
    got = visibility.visible_points(points, depth, intrinsics, extrinsics, 0.05)
    want = slow(points, depth, intrinsics, extrinsics, 0.05)
    before = camera.to_camera(points, extrinsics)[:, 2] > 0.05
    np.testing.assert_array_equal(got, want & before)
    assert 100 < got.sum() < len(points) - 300
