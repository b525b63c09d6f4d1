"""Photographs of objects without their background, for `masks.py --cutouts`.

They come with Tux Paint: Debian package tuxpaint-stamps-default (2022.06.04, GPL-2.0-or-later),
folder usr/share/tuxpaint/stamps. The package need not be installed, only unpacked:

    apt-get download tuxpaint-stamps-default
    dpkg-deb -x tuxpaint-stamps-default_*.deb unpacked

`NAMES` are all of its photographs of single artefacts whose longer side is at least 160 pixels and
whose main part has at least 99 % of the opaque pixels. Drawings, animals and plants are left out.
"""

import numpy as np
from PIL import Image

from psgn_jax.data import camera
from psgn_jax.data.schema import Sample

NAMES = (
    "hobbies/music/brass/trumpet",
    "hobbies/music/percussion/cymbal_crash",
    "hobbies/music/percussion/drum_tomtom_floor",
    "hobbies/music/percussion/drumkit",
    "hobbies/music/string/cello",
    "hobbies/music/string/guitar_classical",
    "hobbies/music/string/guitar_electric",
    "hobbies/music/string/guitar_electric_bass",
    "hobbies/music/wind/bassoon",
    "household/Lightbulb",
    "household/cylinder",
    "household/home_compost_bin",
    "household/toilet",
    "household/tools/cementmixer",
    "household/tools/spade",
    "household/tools/toolbox",
    "medical/stethoscope",
    "medical/syringe",
    "military/vehicles/bradley",
    "military/vehicles/f22_raptor",
    "military/vehicles/infantry-stryker",
    "seasonal/christmas/Christmas_Tree_photo",
    "seasonal/christmas/German_Christmas_toy",
    "seasonal/halloween/grave-d",
    "space/apollo_lander",
    "town/monuments/inukshuk-photo",
    "town/usps_mailbox",
    "vehicles/construction/dumper",
    "vehicles/emergency/firetruck",
    "vehicles/flight/planes/747",
    "vehicles/garbagetruck",
    "vehicles/masstransit/green_korean_bus",
    "vehicles/race/indycar",
    "vehicles/ship/walnutBoat",
    "vehicles/wheel_tractor",
)

LARGEST_SIDE = 480
HEIGHT = 0.8  # the height or width of the object in the frame of its camera


def read(path):
    """A cut-out as a sample: an upright board in the plane x = 0 that stands on the ground."""
    picture = Image.open(path).convert("RGBA")
    picture.thumbnail((LARGEST_SIDE, LARGEST_SIDE), Image.Resampling.LANCZOS)
    array = np.asarray(picture)
    mask = array[..., 3] > 127
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    array = array[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    mask = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    intrinsics, extrinsics = camera.default_camera((192, 256))
    intrinsics = intrinsics.astype(np.float64)
    # The origin of the frame appears at the middle of the lower edge.
    intrinsics[:2, :2] *= max(mask.shape) / HEIGHT * extrinsics[2, 3] / intrinsics[0, 0]
    intrinsics[:2, 2] = 0
    x, y, depth = intrinsics @ extrinsics[:, 3]
    intrinsics[:2, 2] = mask.shape[1] / 2 - x / depth, mask.shape[0] - y / depth
    down, across = np.nonzero(mask)
    pixels = np.stack([across + 0.5, down + 0.5, np.ones(len(down))])
    turn, shift = extrinsics[:, :3].astype(np.float64), extrinsics[:, 3]
    origin, rays = -turn.T @ shift, turn.T @ np.linalg.inv(intrinsics) @ pixels
    points = (origin[:, None] - origin[0] / rays[0] * rays).T
    return Sample(
        image=np.ascontiguousarray(array[..., :3]),
        mask=mask,
        points=points.astype(np.float32),
        intrinsics=intrinsics.astype(np.float32),
        extrinsics=extrinsics,
    )


def samples(folder):
    """The cut-outs of `NAMES` below a folder, in order."""
    return [read(folder / f"{name}.png") for name in NAMES]
