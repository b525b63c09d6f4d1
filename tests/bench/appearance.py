"""Statistics of the pixels of objects: fine detail, hues, saturation, brightness.

    python -m psgn_jax.convert authors BATCHES AUTHORS
    python data_gen/render.py --catalogue=procedural --source=16 --out=RENDERED --config.views=1
    python tests/bench/appearance.py AUTHORS RENDERED [--split train] [--limit 400]

Prints a column for each folder of records. The first folder is the reference of the distances. Each
figure is a share of the object's pixels, averaged over images. The mask is eroded by 2 pixels, so
that the outline does not count.

Fine detail: the share of pixels where the Laplacian of the luminance (.299 R + .587 G + .114 B, 0
to 255, four neighbours) is above 15 in absolute value. The Laplacian is small on flat and smoothly
shaded surfaces, and large at textures, seams, small parts and hard edges. The share is .335 for the
authors' images.

Hue: the share of all object pixels in each twelfth of the colour circle. Only pixels with a
saturation of at least .2 and a value of at least .15 (HSV) have a hue; the others count as grey.
Purple: hues of 270 to 330 degrees. Distance: half the sum of absolute differences from the
histogram of the first folder, 0 = equal, 1 = disjoint. The histograms of saturation and value have
ten bins.
"""

import argparse
from typing import NamedTuple

import numpy as np
import scipy.ndimage

from psgn_jax.data.dataset import open_split

DETAIL_THRESHOLD = 15.0
LEAST_SATURATION, LEAST_VALUE = 0.2, 0.15
HUES = ("red", "orange", "yellow", "lime", "green", "spring", "cyan", "azure", "blue", "violet",
        "magenta", "rose")  # fmt: skip


class Appearance(NamedTuple):
    """Shares of object pixels: fine detail, hues (the last is grey), saturation, value, purple."""

    detail: float
    hue: np.ndarray
    saturation: np.ndarray
    value: np.ndarray
    purple: float


def fine_detail(image: np.ndarray, core: np.ndarray) -> float:
    """The share of `core` pixels with a Laplacian above the threshold."""
    luminance = image.astype(np.float32) @ np.array([0.299, 0.587, 0.114], np.float32)
    return float((np.abs(scipy.ndimage.laplace(luminance)[core]) > DETAIL_THRESHOLD).mean())


def hue_saturation_value(rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """HSV of colours [n, 3] in [0, 255]: degrees, [0, 1], [0, 1]."""
    colour = rgb.astype(np.float32) / 255
    value, low = colour.max(axis=1), colour.min(axis=1)
    spread = np.maximum(value - low, 1e-6)
    red, green, blue = colour.T
    hue = np.select(
        [value == red, value == green],
        [(green - blue) / spread, 2 + (blue - red) / spread],
        4 + (red - green) / spread,
    )
    return hue * 60 % 360, (value - low) / np.maximum(value, 1e-6), value


def appearance(image: np.ndarray, mask: np.ndarray) -> Appearance | None:
    """The figures of one image; None if the eroded mask is empty."""
    core = scipy.ndimage.binary_erosion(mask, iterations=2)
    if not core.any():
        return None
    hue, saturation, value = hue_saturation_value(image[core])
    coloured = (saturation >= LEAST_SATURATION) & (value >= LEAST_VALUE)
    # Each twelfth is centred on the angle of its name: red is -15 to 15 degrees.
    number = np.where(coloured, (hue + 15) % 360 // 30, len(HUES)).astype(int)
    count = len(hue)
    return Appearance(
        fine_detail(image, core),
        np.bincount(number, minlength=len(HUES) + 1) / count,
        np.histogram(saturation, 10, (0, 1))[0] / count,
        np.histogram(value, 10, (0, 1))[0] / count,
        float((coloured & (hue >= 270) & (hue < 330)).mean()),
    )


def of_folder(folder: str, split: str, limit: int) -> tuple[Appearance, int]:
    """The mean over at most `limit` images spread over a split, and their number."""
    reader = open_split([folder], split)
    chosen = np.unique(np.linspace(0, len(reader) - 1, limit).astype(int))
    each = []
    for i in chosen:
        sample = reader.stored(int(i), ("image", "mask"))
        assert sample.image is not None
        assert sample.mask is not None
        one = appearance(sample.image, sample.mask)
        each += [] if one is None else [one]
    mean = Appearance(*(np.mean(values, axis=0) for values in zip(*each, strict=True)))
    return mean, len(each)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folders", nargs="+", help="of records; the first is the reference")
    parser.add_argument("--split", default="train")
    parser.add_argument("--limit", type=int, default=400, help="images of each folder")
    arguments = parser.parse_args()
    results = [of_folder(f, arguments.split, arguments.limit) for f in arguments.folders]
    (first, _), columns = results[0], [a for a, _ in results]

    def row(name: str, values: list[float]) -> None:
        print(f"{name:26}" + "".join(f"{v:10.3f}" for v in values))

    print(" " * 26 + "".join(f"{n:10d}" for _, n in results), "images")
    row("fine detail", [a.detail for a in columns])
    row("purple", [a.purple for a in columns])
    for number, name in enumerate((*HUES, "grey")):
        row(f"hue {name}", [a.hue[number] for a in columns])
    centres = np.arange(10) / 10 + 0.05
    row("mean saturation", [float(a.saturation @ centres) for a in columns])
    row("mean value", [float(a.value @ centres) for a in columns])
    for name in ("hue", "saturation", "value"):
        own = [np.abs(getattr(a, name) - getattr(first, name)).sum() / 2 for a in columns]
        row(f"distance in {name}", own)


if __name__ == "__main__":
    main()
