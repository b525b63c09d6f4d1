"""Draws the clouds that a network predicts from the model card's ten photos: docs/photos.png.

    python tests/bench/photos.py [--weights NAME|FILE | --workdir RUN] --out docs/photos.png

Each photo of `--photos` (default: docs/photos) has a row: the photo; the mask that `psgn predict`
finds, with the cloud of this mask from the camera of the photo and turned by 75 degrees about the
vertical axis; then the given mask, `NAME_mask.png`, with its cloud. All clouds are in normal form
and coloured by height. Also prints the method and the IoU of each mask that was found.
"""

import argparse
import io
import pathlib
import sys

import numpy as np
from PIL import Image, ImageDraw, ImageFont

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from psgn_jax.commands.common import exit_on_user_error
from psgn_jax.data import camera, masks, photo
from psgn_jax.prediction.predictor import Predictor
from psgn_jax.system.files import write_atomic
from psgn_jax.viewing import spheres
from psgn_jax.viewing.spheres import turned
from psgn_jax.weights.opening import open_network

PHOTOS = pathlib.Path(__file__).resolve().parents[2] / "docs" / "photos"
PANEL = (150, 200)  # height, width
TURNS = (0, 75)
GAP, HEAD, LABEL = 10, 40, 24
LARGEST = 480_000
OUTSIDE = np.array([60, 90, 160])
TEXT, PALE = (40, 40, 40), (120, 120, 120)


def panel(picture):
    """A picture that fits into a panel, on white."""
    framed = Image.new("RGB", PANEL[::-1], "white")
    small = Image.fromarray(picture)
    factor = min(PANEL[0] / small.height, PANEL[1] / small.width)
    size = round(factor * small.width), round(factor * small.height)
    small = small.resize(size, Image.Resampling.LANCZOS)
    framed.paste(small, ((PANEL[1] - size[0]) // 2, (PANEL[0] - size[1]) // 2))
    return framed


def cut_out(image, mask):
    """The image with the part outside the mask in blue."""
    grey = image.mean(axis=2, keepdims=True)
    return np.where(mask[..., None], image, 0.25 * grey + OUTSIDE).astype(np.uint8)


def views(prediction):
    """Pictures of a cloud from the camera of the photo, and turned."""
    points = prediction.points[0]
    view = prediction.view
    intrinsics = camera.scale_intrinsics(view.intrinsics, view.mask.shape, PANEL)
    colours = spheres.colours_by_height(points)
    return [
        Image.fromarray(
            spheres.render(points, colours, intrinsics, turned(view.extrinsics, angle), PANEL)
        )
        for angle in TURNS
    ]


def row(name, image, given, predictor):
    """The seven pictures of a photo with their labels, and the label of the mask that was found."""
    try:
        found = masks.find_mask(image)
    except photo.PhotoError:
        text, mask = "no object found", np.zeros_like(given)
        clouds = [Image.new("RGB", PANEL[::-1], "white")] * len(TURNS)
    else:
        text, mask = f"{found.method}, IoU {masks.mask_iou(found.mask, given):.2f}", found.mask
        text += ", in doubt" if found.doubt else ""
        clouds = views(predictor(image, mask))
    panels = [(name, panel(image)), (text, panel(cut_out(image, mask)))]
    panels += [("", cloud) for cloud in clouds]
    panels += [("", panel(cut_out(image, given)))]
    panels += [("", cloud) for cloud in views(predictor(image, given))]
    return panels, text


def sheet(rows):
    """All rows in one picture, under headings."""
    font, small = ImageFont.load_default(17), ImageFont.load_default(15)
    high, wide = PANEL
    lefts = [GAP + i * (wide + GAP) + (2 * GAP if i else 0) + (2 * GAP if i > 3 else 0)
             for i in range(7)]  # fmt: skip
    step = LABEL + high + GAP
    page = Image.new("RGB", (lefts[-1] + wide + GAP, HEAD + len(rows) * step), "white")
    pen = ImageDraw.Draw(page)
    for column, text in (
        (0, "photo"),
        (1, "mask found, and its cloud"),
        (4, "mask given, and its cloud"),
    ):
        pen.text((lefts[column], 10), text, fill=TEXT, font=font)
    for number, panels in enumerate(rows):
        top = HEAD + number * step
        pen.line((GAP, top, page.width - GAP, top), fill=(225, 225, 225))
        for left, (text, picture) in zip(lefts, panels, strict=True):
            pen.text((left, top + 4), text, fill=PALE, font=small)
            page.paste(picture, (left, top + LABEL))
    return page


def encoded(page):
    """The bytes of a PNG with as many colours as its size allows; white stays white."""
    white = (np.asarray(page) == 255).all(axis=2)
    for colours in (255, 127, 63):
        palette = page.quantize(colours)
        drawn = page.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)
        indices = np.where(white, colours, np.asarray(drawn)).astype(np.uint8)
        picture = Image.fromarray(indices, "P")
        picture.putpalette([*drawn.getpalette()[: 3 * colours], 255, 255, 255])
        stream = io.BytesIO()
        picture.save(stream, "PNG", optimize=True)
        if stream.tell() <= LARGEST:
            break
    return stream.getvalue()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--weights", default="", help="file or name; default: the package's")
    parser.add_argument("--workdir", default="", help="folder of a run")
    parser.add_argument("--photos", type=pathlib.Path, default=PHOTOS)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    arguments = parser.parse_args()
    with exit_on_user_error():
        network = open_network(arguments.workdir or None, arguments.weights or None)
        predictor = Predictor(network)
        rows = []
        for path in sorted(arguments.photos.glob("*.jpg")):
            read = photo.read_photo(path)
            given = photo.read_mask(path.with_name(f"{path.stem}_mask.png"), read)
            panels, text = row(path.stem, read.image, given, predictor)
            rows.append(panels)
            print(f"{path.stem}: {text}")
        write_atomic(arguments.out, encoded(sheet(rows)))


if __name__ == "__main__":
    main()
