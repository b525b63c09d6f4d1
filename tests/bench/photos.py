"""Draws the clouds that a network predicts from the model card's ten photos.

    python tests/bench/photos.py [--weights NAME|FILE | --workdir RUN] --out docs

`photos.png` has a row for each photo of docs/photos: the photo; the mask that `psgn predict` finds,
with the cloud of this mask from the camera of the photo and turned by 75 degrees about the vertical
axis; then the given mask, `NAME_mask.png`, with its cloud. `three_photos.png` and the animation
`turning.webp` show the photos of the README, `--readme`, with their given masks. All clouds are in
normal form and coloured by height. Also prints the method and the IoU of each mask that was found.
"""

import io
import pathlib
import sys

import numpy as np
from PIL import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from small_png import small_png

from psgn_jax.commands.common import define_network_flags
from psgn_jax.config.command_line import Flags
from psgn_jax.data import photo
from psgn_jax.prediction import masks
from psgn_jax.prediction.predictor import Predictor
from psgn_jax.system.files import write_atomic
from psgn_jax.viewing import spheres
from psgn_jax.weights.opening import open_network

PHOTOS = pathlib.Path(__file__).resolve().parents[2] / "docs" / "photos"
HIGH, WIDE = 150, 200
LARGEST = 480_000
OUTSIDE = np.array([60, 90, 160])
FRAMES, FRAME = 40, 90
"""Frames of a turn, and the milliseconds of each."""


def panel(picture):
    """A picture that fits into a panel, on white."""
    framed, small = Image.new("RGB", (WIDE, HIGH), "white"), Image.fromarray(picture)
    small.thumbnail((WIDE, HIGH), Image.Resampling.LANCZOS)
    framed.paste(small, ((WIDE - small.width) // 2, (HIGH - small.height) // 2))
    return np.asarray(framed)


def masked(image, mask, predictor, which, title):
    """The image with the part outside the mask in blue, and the cloud from two sides."""
    grey = image.mean(axis=2, keepdims=True)
    blue = np.where(mask[..., None], image, 0.25 * grey + OUTSIDE).astype(np.uint8)
    prediction = predictor(image, mask)
    clouds = spheres.by_height({f"cloud, {which} mask": prediction.points[0]})
    pictures = spheres.panels(vars(prediction.view), clouds, height=HIGH)
    return {title: panel(blue), **dict(list(pictures.items())[1:])}


def row(image, given, predictor):
    """The pictures of a photo by title, and the label of the mask that was found."""
    pictures = {"photo": panel(image)}
    try:
        found = masks.find_mask(image)
    except photo.PhotoError:
        text = "no object found"
        empty = np.full((HIGH, WIDE, 3), 255, np.uint8)
        pictures |= {text: panel(image), " ": empty, "  ": empty}
    else:
        text = f"{found.method}, IoU {masks.mask_iou(found.mask, given):.2f}"
        pictures |= masked(image, found.mask, predictor, "found", f"found: {text}")
    return pictures | masked(image, given, predictor, "given", "given"), text


def cloud_picture(prediction, turn, high):
    """The cloud from the camera of the photo, turned by `turn` degrees."""
    clouds = spheres.by_height({"cloud": prediction.points[0]})
    drawn = spheres.panels(vars(prediction.view), clouds, turns=(turn,), height=high)
    return list(drawn.values())[-1]


def side_by_side(image, prediction):
    """The photo, and its cloud from the camera of the photo."""
    high = 15 * HIGH // 12
    above = np.full(((high - HIGH) // 2, WIDE, 3), 255, np.uint8)
    below = np.full((high - HIGH - len(above), WIDE, 3), 255, np.uint8)
    left = np.concatenate([above, panel(image), below])
    return np.concatenate([left, cloud_picture(prediction, 0, high)], axis=1)


def animation(predictions):
    """A WebP of clouds beside each other, each turning about its vertical axis."""
    frames = []
    for turn in 360 * np.arange(FRAMES) / FRAMES:
        pictures = [cloud_picture(each, turn, 2 * HIGH) for each in predictions]
        frames.append(Image.fromarray(np.concatenate(pictures, axis=1)))
    stream = io.BytesIO()
    options = {"duration": FRAME, "loop": 0, "quality": 70, "method": 6}
    frames[0].save(stream, "WEBP", save_all=True, append_images=frames[1:], **options)
    return stream.getvalue()


def main():
    flags = Flags("photos.py --out=FOLDER", __doc__)
    define_network_flags(flags)
    flags.string("readme", "aeroplane,car,chair", "Photos of the README.")
    flags.string("out", None, "Folder to write to.")
    return flags.run(_main)


def _main(flags):
    values = flags.values
    predictor = Predictor(open_network(values.workdir, values.weights, values.checkpoint))
    out, names, rows, chosen = pathlib.Path(values.out), values.readme.split(","), [], {}
    for path in sorted(PHOTOS.glob("*.jpg")):
        read = photo.read_photo(path)
        given = photo.read_mask(path.with_name(f"{path.stem}_mask.png"), read)
        if path.stem in names:
            chosen[path.stem] = read.image, predictor(read.image, given)
        pictures, text = row(read.image, given, predictor)
        rows.append((path.stem, pictures))
        print(f"{path.stem}: {text}")
    three = np.concatenate([side_by_side(*chosen[name]) for name in names], axis=1)
    write_atomic(out / "photos.png", small_png(spheres.sheet(rows, columns=1), LARGEST))
    write_atomic(out / "three_photos.png", small_png(Image.fromarray(three), LARGEST))
    write_atomic(out / "turning.webp", animation([chosen[name][1] for name in names]))


if __name__ == "__main__":
    sys.exit(main())
