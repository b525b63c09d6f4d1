import dataclasses

import numpy as np
from helpers.refusals import all_refused

from psgn_jax.data import schema
from psgn_jax.data.codec import decode, encode


def test_each_wrong_field_is_named(sample):
    all_refused(
        lambda change: schema.validate(dataclasses.replace(sample, **change)),
        ValueError,
        [
            ({field: value}, f"'{field}'", "got", "expected")
            for field, value in (
                ("image", np.zeros((24, 32, 3), np.float32)),
                ("image", np.zeros((4097, 1, 3), np.uint8)),
                ("mask", np.zeros((24, 31), np.bool_)),
                ("depth", np.full((24, 32), -1, np.float32)),
                ("depth", np.full((24, 32), np.nan, np.float32)),
                ("depth", np.full((24, 32), 2e9, np.float32)),
                ("points", np.full((200, 3), -2e9, np.float32)),
                ("points", np.zeros((0, 3), np.float32)),
                ("points", np.full((200, 3), np.inf, np.float32)),
                ("points", np.zeros((200, 3), ">f8")),
                ("occupancy", np.zeros((16, 16, 16), np.bool_)),
                ("intrinsics", np.diag([-1, 1, 1]).astype(np.float32)),
                ("extrinsics", np.eye(3, 4, dtype=np.float32) * np.float32([[-1], [1], [1]])),
                ("category", None),
                ("model_id", "caf\udce9"),
                ("view", 1.5),
            )
        ],
    )


def test_arrays_of_another_byte_order_are_stored_in_the_usual_one(sample):
    names = ("depth", "points", "intrinsics", "extrinsics")
    other = {name: getattr(sample, name).astype(">f4") for name in names}
    assert encode(dataclasses.replace(sample, **other)) == encode(sample)
    assert decode(encode(sample)).points.dtype == np.dtype("=f4")
