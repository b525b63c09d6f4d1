"""Measures the segmentation of photos that have no given mask (`psgn_jax.data.masks`).

    python tests/bench/masks.py RECORDS... [--count 300] [--seed 0] [--sheet out.png]
    python tests/bench/masks.py --cutouts FOLDER [--backdrops] [--count 105]
    python tests/bench/masks.py RECORDS... --fit        # new weights of the choice between masks

RECORDS are folders of rendered records. Models of the split `--split` (default: test, on which no
network was trained) are composited over backgrounds. With `--cutouts`, the objects are photographs
without their background (`cutouts.py`), each in turn. Without `--backdrops`, the three kinds of
background, used in turn, are:

- photo: a random part of a photograph that comes with an installed package (scikit-image,
  scikit-learn, matplotlib or gradio; those that are missing are left out);
- texture: one of the textures of `data_gen.catalogues.families.textures`, repeated;
- room: surroundings and ground of `data_gen`'s preset `photo`, seen by the object's camera, with
  its shadow.

With `--cutouts` and `--backdrops`, the backgrounds are those of product photos, in turn: plain, one
colour; and shaded, with a gradient, a soft shadow and some noise. The method is then `auto` by
default.

Objects take 30 to 80 % of the image in one direction, with `--backdrops` 40 to 85 %, and do not
touch its border. Edges, exposure, blur, noise and JPEG quality vary. The same seed gives the same
images. The command prints, for each kind, the mean and median IoU with the true mask, the share of
images with an IoU below .5, and the CPU milliseconds per image; then the number of images with and
without a warning, and their IoU.
With `--method single`, the method is a single GrabCut that starts from a band along the border.
Ctrl-C ends the measurement and prints the table of the images so far.

`--fit` prints the least-squares weights of `segmentation.WEIGHTS`. It uses the training split and
half of the photographs; the figures above are measured on the other half.
"""

import argparse
import contextlib
import importlib.util
import io
import pathlib
import sys
import time

import numpy as np
import scipy.ndimage
from PIL import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import cutouts

from data_gen import grounds, surroundings
from data_gen.catalogues.families import textures
from data_gen.lights import LightSettings
from data_gen.photo.light import look_around
from psgn_jax.data import masks, photo
from psgn_jax.data.dataset import RecordReader

SIZE = (360, 480)
KINDS = ("photo", "texture", "room")
BACKDROPS = ("plain", "shaded")

# Package, file. The files are used alternately for the figures and for the fit.
PHOTOGRAPHS = (
    ("skimage", "data/astronaut.png"),
    ("skimage", "data/coffee.png"),
    ("skimage", "data/rocket.jpg"),
    ("skimage", "data/chelsea.png"),
    ("matplotlib", "mpl-data/sample_data/grace_hopper.jpg"),
    ("skimage", "data/motorcycle_left.png"),
    ("sklearn", "datasets/images/china.jpg"),
    ("sklearn", "datasets/images/flower.jpg"),
    ("gradio", "media_assets/images/tower.jpg"),
    ("gradio", "media_assets/images/cheetah.jpg"),
    ("gradio", "media_assets/images/lion.jpg"),
    ("gradio", "media_assets/images/groot.jpeg"),
    ("skimage", "data/brick.png"),
    ("skimage", "data/gravel.png"),
)


def photographs(fit):
    """The photographs that are installed, uint8 [h, w, 3] by name."""
    found = {}
    for package, name in PHOTOGRAPHS[1::2] if fit else PHOTOGRAPHS[::2]:
        spec = importlib.util.find_spec(package)
        for folder in spec.submodule_search_locations if spec else ():
            path = pathlib.Path(folder) / name
            if path.is_file():
                found[f"{package}/{path.name}"] = np.asarray(Image.open(path).convert("RGB"))
    return found


def cropped(rng, picture, size):
    """A random part of a picture, at least half of it in one direction, resized."""
    height, width = picture.shape[:2]
    share = min(height / size[0], width / size[1]) * rng.uniform(0.5, 1)
    high, wide = int(share * size[0]), int(share * size[1])
    top, left = rng.integers(height - high + 1), rng.integers(width - wide + 1)
    part = Image.fromarray(picture[top : top + high, left : left + wide])
    array = np.asarray(part.resize(size[::-1], Image.Resampling.LANCZOS))
    return array[:, ::-1] if rng.random() < 0.5 else array


TEXTURES = (
    (textures.wood, ("straight", "cathedral", "planks")),
    (textures.weave, ("plain", "twill", "knit")),
    (textures.masonry, ("brick", "tiles")),
    (textures.stone, ("marble", "granite", "concrete", "plaster")),
    (textures.foliage, ("leaves", "grass", "straw")),
)


def texture(rng, size):
    """A repeated, tinted and rotated texture."""
    maker, kinds = TEXTURES[int(rng.integers(len(TEXTURES)))]
    tile = np.asarray(maker(str(rng.choice(kinds)), int(rng.integers(4))))[..., :3]
    tile = Image.fromarray(tile).resize(2 * (int(rng.integers(120, 400)),))
    whole = np.tile(np.asarray(tile), (7, 7, 1))[:960, :960]
    top, left = rng.integers(0, 120, 2)
    turned = Image.fromarray(whole).rotate(rng.uniform(0, 360), Image.Resampling.BICUBIC)
    middle = np.asarray(turned)[420 - size[0] // 2 + top :, 420 - size[1] // 2 + left :]
    tinted = middle[: size[0], : size[1]] * rng.uniform(0.5, 1.3) * rng.uniform(0.6, 1.2, 3)
    return tinted.clip(0, 255)


def room(rng, size, sample, to_canvas):
    """Ground and surroundings seen by the sample's camera, with the shadow of its points."""
    _, around = surroundings.draw(rng, LightSettings(source="mixed"), None)
    ground = grounds.draw(rng, "random", around)
    rows, columns = np.mgrid[: size[0], : size[1]] + 0.5
    pixels = np.stack([columns.ravel(), rows.ravel(), np.ones(rows.size)])
    rays = np.linalg.inv(to_canvas @ sample.intrinsics) @ pixels
    turn, shift = sample.extrinsics[:, :3], sample.extrinsics[:, 3]
    rays = (turn.T @ rays).T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    origin = -turn.T @ shift
    seen = look_around(around.radiance, rays.astype(np.float32))
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(rays[:, 2] < -1e-4, -origin[2] / rays[:, 2], np.inf)
    down = np.flatnonzero(reach < 60)
    places = (origin[:2] + reach[down, None] * rays[down, :2]).astype(np.float32)
    down, places = down[ground.holds(places)], places[ground.holds(places)]
    # The shadow: the points of the object, projected along the light onto the ground.
    away = rng.normal(0, 0.6, 2)
    fallen = sample.points[:, :2] + sample.points[:, 2:] * away
    edges = np.linspace(-3, 3, 193)
    counts, _, _ = np.histogram2d(*fallen.T, bins=(edges, edges))
    shade = scipy.ndimage.gaussian_filter((counts > 0).astype(float), rng.uniform(1, 4))
    cell = np.clip(((places + 3) * 32).astype(int), 0, 191)
    lit = 1 - rng.uniform(0.3, 0.8) * shade[cell[:, 0], cell[:, 1]]
    colour = ground.colour(places, reach[down].astype(np.float32) / 400)
    seen[down] = colour * lit[:, None] * rng.uniform(0.9, 2)
    level = np.quantile(seen, 0.9)
    return (255 * np.clip(seen / max(level, 1e-3) * 0.8, 0, 1) ** (1 / 2.2)).reshape(*size, 3)


def composite(rng, sample, kind, pictures, enlarged=np.inf):
    """An image, uint8 [h, w, 3], and the mask of its object.

    The object is enlarged by at most the factor `enlarged`.
    """
    size = SIZE if rng.random() < 0.75 else SIZE[::-1]
    rows, columns = np.flatnonzero(sample.mask.any(1)), np.flatnonzero(sample.mask.any(0))
    high, wide = np.ptp(rows) + 1, np.ptp(columns) + 1
    factor = min(rng.uniform(0.3, 0.8) * min(size[0] / high, size[1] / wide), enlarged)
    free = size[0] - factor * high, size[1] - factor * wide
    top, left = (np.clip(rng.normal(0.5, 0.2), 0.06, 0.94) * each for each in free)
    to_canvas = np.array(
        [[factor, 0, left - factor * columns[0]], [0, factor, top - factor * rows[0]], [0, 0, 1]]
    )
    inverse = np.linalg.inv(to_canvas)[:2].ravel()

    def moved(array):
        picture = Image.fromarray(array)
        return np.asarray(
            picture.transform(
                size[::-1], Image.Transform.AFFINE, inverse, Image.Resampling.BICUBIC
            ),
            np.float64,
        )

    # The grey background of the record is mixed into the pixels at the object's edge.
    behind = ~sample.mask
    nearest = scipy.ndimage.distance_transform_edt(
        behind | ~scipy.ndimage.binary_erosion(sample.mask), return_indices=True
    )[1]
    colours = moved(np.ascontiguousarray(sample.image[tuple(nearest)]))
    alpha = moved(sample.mask.astype(np.uint8) * 255) / 255
    alpha = scipy.ndimage.gaussian_filter(alpha, rng.uniform(0.3, 0.9)).clip(0, 1)
    if kind == "photo":
        back = cropped(rng, pictures[int(rng.integers(len(pictures)))], size).astype(float)
    elif kind == "texture":
        back = texture(rng, size)
    else:
        back = room(rng, size, sample, to_canvas)
    blur = rng.uniform(0, 1.5)
    back = np.stack([scipy.ndimage.gaussian_filter(back[..., i], blur) for i in range(3)], 2)
    image = back + alpha[..., None] * (colours * rng.uniform(0.75, 1.2) - back)
    image = image * rng.uniform(0.8, 1.15) * rng.uniform(0.93, 1.07, 3)
    image = image + rng.normal(0, rng.uniform(0, 6), image.shape)
    stream = io.BytesIO()
    jpeg = Image.fromarray(image.clip(0, 255).astype(np.uint8))
    jpeg.save(stream, "JPEG", quality=int(rng.integers(70, 96)))
    return np.asarray(Image.open(stream)), alpha > 0.5


def backdrop(rng, sample, shaded):
    """A cut-out on a backdrop, as a JPEG: an image, and the mask of its object."""
    high, wide = sample.mask.shape
    factor = min(rng.uniform(0.4, 0.85) * min(SIZE[0] / high, SIZE[1] / wide), 1.5)
    high, wide = round(factor * high), round(factor * wide)
    top, left = (SIZE[0] - high) // 2, (SIZE[1] - wide) // 2
    part = np.s_[top : top + high, left : left + wide]
    alpha, colours = np.zeros(SIZE), np.zeros((*SIZE, 3))
    for array, source in ((alpha, 255 * sample.mask.astype(np.uint8)), (colours, sample.image)):
        array[part] = np.asarray(Image.fromarray(source).resize((wide, high)))
    alpha /= 255
    level = rng.choice([255, 255, 245, 225, 191, 120, 30])
    tint = 1 if level == 255 else rng.uniform(0.92, 1.05, 3)
    back = np.ones((*SIZE, 3)) * level * tint
    if shaded:
        rows, columns = np.meshgrid(*(np.linspace(-1, 1, side) for side in SIZE), indexing="ij")
        slope = rng.normal(0, 4, 2)
        vignette = rng.uniform(0, 6) * (rows**2 + columns**2)
        back += (slope[0] * columns + slope[1] * rows - vignette)[..., None]
        shadow = scipy.ndimage.gaussian_filter(np.roll(alpha, (8, 20), (0, 1)), 12)
        back *= 1 - rng.uniform(0, 0.25) * shadow[..., None]
        back += rng.normal(0, rng.uniform(0, 1.5), back.shape)
    image = back + alpha[..., None] * (colours - back)
    stream = io.BytesIO()
    jpeg = Image.fromarray(image.clip(0, 255).astype(np.uint8))
    jpeg.save(stream, "JPEG", quality=int(rng.choice([70, 80, 88, 95])))
    return np.asarray(Image.open(stream)), alpha > 0.5


def cutouts_on_backdrops(folder, count, seed):
    """Yields (kind, image, mask); each cut-out in turn."""
    objects = cutouts.samples(folder)
    for number in range(count):
        rng = np.random.default_rng((seed, number))
        shaded = (number + number // len(objects)) % 2
        yield BACKDROPS[shaded], *backdrop(rng, objects[number % len(objects)], shaded)


def backgrounds(fit):
    """The kinds of background that there are, and photographs."""
    pictures = photographs(fit)
    print(f"photographs: {', '.join(pictures) or 'none'}", file=sys.stderr)
    return KINDS if pictures else KINDS[1:], list(pictures.values())


def composites_of_cutouts(folder, count, seed):
    """Yields (kind, image, mask); each cut-out in turn, on each kind of background."""
    kinds, pictures = backgrounds(False)
    objects = cutouts.samples(folder)
    for number in range(count):
        rng = np.random.default_rng((seed, number))
        kind = kinds[(number + number // len(objects)) % len(kinds)]
        yield kind, *composite(rng, objects[number % len(objects)], kind, pictures, enlarged=1.5)


def composites(folders, split, count, seed, fit):
    """Yields (kind, image, mask)."""
    readers = [RecordReader(folder, split) for folder in folders]
    kinds, pictures = backgrounds(fit)
    for number in range(count):
        rng = np.random.default_rng((seed, fit, number))
        while True:
            reader = readers[int(rng.integers(len(readers)))]
            sample = reader[int(rng.integers(len(reader)))]
            if sample.mask.mean() > 0.02:
                break
        kind = kinds[number % len(kinds)]
        yield kind, *composite(rng, sample, kind, pictures)


def least_squares(features, targets):
    """Ridge regression of standardised features; returns weights of the original features."""
    scale = np.maximum(features.std(axis=0), 1e-6)
    matrix = features / scale
    penalty = 0.1 * len(targets) * np.eye(matrix.shape[1])
    return np.linalg.solve(matrix.T @ matrix + penalty, matrix.T @ targets) / scale


def fit_weights(cases):
    """Fits and prints the weights of the rank and of the score.

    The rank orders the candidates of an image. The score estimates the IoU of the chosen mask.
    """
    from psgn_jax.data import segmentation

    seeds = list(segmentation.RANK_OF_SEED)
    features, targets, groups, places = [], [], [], []
    for number, (_, image, mask) in enumerate(cases):
        for each in segmentation.candidates(image):
            features.append(each.features)
            targets.append(masks.mask_iou(each.mask, photo.resize_mask(mask, each.mask.shape)))
            groups.append(number)
            places.append(seeds.index(each.seed))
    report_fit(np.array(features), np.array(targets), np.array(groups), np.array(places), seeds)


def report_fit(features, targets, groups, places, seeds):
    """Fits the weights and prints them."""
    from psgn_jax.data import segmentation

    def centred(values):
        result = np.array(values, float)
        for group in np.unique(groups):
            result[groups == group] -= result[groups == group].mean(axis=0)
        return result

    wide = np.concatenate([features[:, :1], np.eye(len(seeds))[places]], axis=1)
    rank = least_squares(centred(wide), centred(targets))
    order = wide @ rank
    chosen = np.array(
        [at[order[at].argmax()] for at in (np.flatnonzero(groups == g) for g in np.unique(groups))]
    )
    best = [targets[groups == group].max() for group in np.unique(groups)]
    offset, level = features[chosen].mean(axis=0), targets[chosen].mean()
    score = least_squares(features[chosen] - offset, targets[chosen] - level)
    constant = level - offset @ score
    estimate = features[chosen] @ score + constant
    print(f"rank of agreement {rank[0]:.3f}")
    for place, (seed, bias) in enumerate(zip(seeds, rank[1:], strict=True)):
        values = targets[places == place]
        print(f"{seed}: mean IoU {values.mean():.3f} of {len(values)}, rank {bias:.3f}")
    print(f"mean IoU of the choice {level:.3f}, of the best candidate {np.mean(best):.3f}")
    print(f"correlation of score and IoU {np.corrcoef(estimate, targets[chosen])[0, 1]:.3f}")
    for name, weight in zip(segmentation.FEATURES, score, strict=True):
        print(f'    "{name}": {weight:.4f},')
    print(f"score of none {constant:.4f}")


def sheet(cases, path):
    """Writes images with the outlines of the computed mask (red) and the true mask (green)."""
    tiles = []
    for image, mask, found in cases:
        tile = image.astype(float)
        for outline, colour in ((mask, (0, 230, 0)), (found, (255, 0, 0))):
            edge = outline ^ scipy.ndimage.binary_erosion(outline, iterations=2)
            tile[edge] = colour
        framed = Image.new("RGB", (240, 240), "white")
        picture = Image.fromarray(tile.astype(np.uint8))
        picture.thumbnail((236, 236))
        framed.paste(picture)
        tiles.append(np.asarray(framed))
    rows = [np.concatenate(tiles[i : i + 8], axis=1) for i in range(0, len(tiles) // 8 * 8, 8)]
    Image.fromarray(np.concatenate(rows)).save(path)


def single(image):
    """The mask of one GrabCut that starts from a band along the border, or None."""
    import cv2

    small = masks._small(image)
    height, width = small.shape[:2]
    down, across = max(1, round(0.03 * height)), max(1, round(0.03 * width))
    labels = np.full((height, width), cv2.GC_BGD, np.uint8)
    labels[down:-down, across:-across] = cv2.GC_PR_FGD
    back, fore = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)
    cv2.grabCut(small, labels, (0, 0, 1, 1), back, fore, 5, cv2.GC_INIT_WITH_MASK)
    parts, count = scipy.ndimage.label((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD))
    areas = np.bincount(parts.ravel(), minlength=count + 1)
    areas[0] = 0
    return photo.resize_mask((areas >= 0.1 * areas.max())[parts] & (parts > 0), image.shape[:2])


def measured(cases, method):
    """Yields (kind, image, mask, found, milliseconds, in doubt)."""
    for kind, image, mask in cases:
        start = time.process_time()
        try:
            if method == "single":
                result, doubt = single(image), False
            else:
                found = masks.find_mask(image, None, method)
                result, doubt = found.mask, bool(found.doubt)
        except photo.PhotoError:
            result, doubt = np.zeros_like(mask), True
        yield kind, image, mask, result, 1000 * (time.process_time() - start), doubt


def report(rows):
    """Prints a table of (kind, IoU, milliseconds, in doubt)."""
    print("background  images  mean IoU  median  below .5  ms")
    for kind in (*KINDS, *BACKDROPS, "all"):
        part = [row[1:] for row in rows if kind in (row[0], "all")]
        if part:
            values, spent, _ = np.array(part).T
            print(
                f"{kind:10s}  {len(part):6d}  {values.mean():8.3f}  {np.median(values):6.3f}  "
                f"{100 * np.mean(values < 0.5):6.1f} %  {np.mean(spent):.0f}"
            )
    doubts = np.array([row[3] for row in rows])
    values = np.array([row[1] for row in rows])
    for text, part in (("in doubt", values[doubts]), ("not in doubt", values[~doubts])):
        if len(part):
            print(
                f"{text}: {len(part)} images, mean IoU {part.mean():.3f}, "
                f"{100 * np.mean(part < 0.5):.1f} % below .5"
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("records", nargs="*", type=pathlib.Path)
    parser.add_argument("--cutouts", type=pathlib.Path, help="folder of Tux Paint's stamps")
    parser.add_argument("--count", type=int, default=0, help="default: 300, of cut-outs 105")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--split", default="")
    parser.add_argument("--backdrops", action="store_true", help="of product photos")
    parser.add_argument("--method", default="", choices=(*masks.METHODS, "single"))
    parser.add_argument("--sheet", help="PNG of the first 64 images")
    parser.add_argument("--fit", action="store_true")
    arguments = parser.parse_args()
    if bool(arguments.records) == bool(arguments.cutouts):
        parser.error("expected either RECORDS or --cutouts")
    if arguments.cutouts:
        make = cutouts_on_backdrops if arguments.backdrops else composites_of_cutouts
        cases = make(arguments.cutouts, arguments.count or 105, arguments.seed)
    else:
        split = arguments.split or ("train" if arguments.fit else "test")
        count = arguments.count or 300
        cases = composites(arguments.records, split, count, arguments.seed, arguments.fit)
    if arguments.fit:
        fit_weights(cases)
        return
    rows, shown = [], []
    method = arguments.method or ("auto" if arguments.backdrops else "grabcut")
    with contextlib.suppress(KeyboardInterrupt):
        for kind, image, mask, result, spent, doubt in measured(cases, method):
            rows.append((kind, masks.mask_iou(result, mask), spent, doubt))
            if len(shown) < 64:
                shown.append((image, mask, result))
    if rows:
        report(rows)
    if arguments.sheet:
        sheet(shown, arguments.sheet)


if __name__ == "__main__":
    main()
