import dataclasses

import numpy as np
import pytest

from psgn_jax.data import schema


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("image", np.zeros((24, 32, 3), np.float32)),
        ("image", np.zeros((4097, 1, 3), np.uint8)),
        ("mask", np.zeros((24, 31), np.bool_)),
        ("depth", np.full((24, 32), -1, np.float32)),
        ("depth", np.full((24, 32), np.nan, np.float32)),
        ("depth", np.full((24, 32), 2e9, np.float32)),
        ("points", np.full((200, 3), -2e9, np.float32)),
        ("points", np.zeros((0, 3), np.float32)),
        ("points", np.full((200, 3), np.inf, np.float32)),
        ("occupancy", np.zeros((16, 16, 16), np.bool_)),
        ("intrinsics", np.diag([-1, 1, 1]).astype(np.float32)),
        ("extrinsics", np.eye(3, 4, dtype=np.float32) * np.float32([[-1], [1], [1]])),
        ("category", None),
        ("view", 1.5),
    ],
)
def test_each_wrong_field_is_named(sample, field, value):
    with pytest.raises(ValueError, match=f"sample field '{field}': got .* expected"):
        schema.validate(dataclasses.replace(sample, **{field: value}))
