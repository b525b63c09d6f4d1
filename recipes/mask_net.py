"""Trains and measures the network that finds masks (`models.mask_net`) on composites.

    python recipes/mask_net.py train --objects FOLDER... --backgrounds FOLDER...
        [--scenes FOLDER...] --sources SOURCES.json --out MASK.safetensors
    python recipes/mask_net.py measure --objects FOLDER... --backgrounds FOLDER...
        [--photos FOLDER...]

An object comes from a record of its split (`train`, or `validation` to measure) or from a PNG file
with transparency. Each folder is drawn equally often. A composite shows one or more objects on a
plain or smooth ground, on a picture, or on a wall and a floor, with shadows, and with the effects
of a camera. One in five shows a part of a record of `--scenes` with its own surroundings: images of
the preset `photo` of the renderer. The mask is that of the central object. Composite i is a
function of i. The encoder, EfficientNet-Lite0 trained on ImageNet, is that of the mask network
`--init`, and stays as it is.

`measure` uses the network of the package: first copy MASK.safetensors to
`psgn_jax/weights/mask.safetensors`. FOLDER of photos has `NAME.jpg` and `NAME_mask.png`.
"""

import argparse
import collections
import concurrent.futures
import json
import multiprocessing
import pathlib

import jax
import jax.numpy as jnp
import numpy as np
import optax
from PIL import Image, ImageFilter

from psgn_jax.data import photo
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.photo_effects import change_light, compress, degrade, smooth_colours
from psgn_jax.models import efficientnet, mask_net
from psgn_jax.prediction import masks
from psgn_jax.weights.file import read_sources, write_arrays
from psgn_jax.weights.leaves import named_leaves
from psgn_jax.weights.mask import FILE, FORMAT, read_mask_network

BATCH, SIDE = 16, 224
BILINEAR = Image.Resampling.BILINEAR


def samples_of(folder, split):
    """The images of a split, with their masks as fourth channel."""
    reader = RecordReader(str(folder), split)
    for i in range(len(reader)):
        sample = reader[i]
        yield np.dstack([sample.image, sample.mask.astype(np.uint8) * 255])


def stamps_of(folder):
    """The pictures of a folder."""
    for path in sorted(folder.rglob("*.png")):
        picture = Image.open(path).convert("RGBA")
        picture.thumbnail((320, 320))
        yield np.asarray(picture)


def box_of(picture):
    """The box of the object in an RGBA picture."""
    return Image.fromarray(picture[..., 3]).point(lambda v: 255 * (v > 127)).getbbox()


def objects_of(folders, split):
    """For each folder, RGBA pictures of objects, cut to their boxes."""
    groups = []
    for folder in map(pathlib.Path, folders):
        has_records = (folder / "manifest.json").is_file()
        group = []
        for picture in samples_of(folder, split) if has_records else stamps_of(folder):
            alpha = picture[..., 3] > 127
            if min(alpha.any(1).sum(), alpha.any(0).sum()) >= 16 and alpha.mean() < 0.9:
                group.append(Image.fromarray(picture).crop(box_of(picture)))
        if not group:
            raise SystemExit(f"{folder}: there is no object of at least 16 pixels")
        groups.append(group)
    return groups


def backgrounds_of(folders):
    """Pictures, reduced to about 640 pixels on their shorter side."""
    found = []
    for path in sorted(p for folder in folders for p in pathlib.Path(folder).rglob("*")):
        if path.suffix.lower() in photo.SUFFIXES:
            picture = Image.open(path).convert("RGB")
            factor = max(1, min(picture.size) // 480)
            found.append(picture.reduce(factor))
    return found


def crop_of(picture, rng, aspect, side=SIDE):
    """A random part of a picture with this ratio of width to height, stretched to a square."""
    width, height = picture.size
    most = min(width / aspect, height)
    high = most * rng.uniform(0.25, 1) ** 0.5
    wide = high * aspect
    left, top = rng.uniform(0, width - wide), rng.uniform(0, height - high)
    part = picture.resize((side, side), BILINEAR, (left, top, left + wide, top + high))
    return part.transpose(Image.Transpose.FLIP_LEFT_RIGHT) if rng.random() < 0.5 else part


def ground_of(backgrounds, rng, aspect):
    """A background, uint8 [SIDE, SIDE, 3]."""
    kind = rng.random()
    if kind < 0.12:
        base = rng.choice([255, 245, 191, 0, rng.integers(256)])
        colour = np.clip(
            base + rng.integers(-8, 9) + rng.integers(-25, 26, 3) * (rng.random() < 0.5), 0, 255
        )
        return np.full((SIDE, SIDE, 3), colour, np.uint8)
    if kind < 0.27:
        return smooth_colours((SIDE, SIDE), rng)

    def picture():
        return np.asarray(crop_of(backgrounds[rng.integers(len(backgrounds))], rng, aspect))

    ground = picture()
    if kind < 0.5:  # a wall, and a floor or a table
        wall = smooth_colours((SIDE, SIDE), rng) if rng.random() < 0.6 else picture()
        edge = rng.uniform(0.3, 0.85) * SIDE + rng.uniform(-0.1, 0.1) * np.arange(SIDE)
        is_wall = np.arange(SIDE)[:, None] < edge[None]
        if rng.random() < 0.4:
            ground = smooth_colours((SIDE, SIDE), rng)
        ground = np.where(is_wall[..., None], wall, ground)
    if rng.random() < 0.4:  # out of focus
        blur = ImageFilter.GaussianBlur(rng.uniform(0.5, 5))
        ground = np.asarray(Image.fromarray(ground).filter(blur))
    return ground


def placed(picture, rng, long_side, centre, aspect, jitter):
    """An object with other colours on an empty canvas, RGBA [SIDE, SIDE, 4]; sizes in pixels."""
    width, height = picture.width / aspect, float(picture.height)
    factor = long_side / max(width, height)
    size = max(4, round(width * factor)), max(4, round(height * factor))
    if rng.random() < 0.5:
        picture = picture.transpose(Image.Transpose.FLIP_LEFT_RIGHT)
    if rng.random() < 0.15:
        picture = picture.rotate(rng.uniform(-25, 25), BILINEAR, expand=True)
    small = picture.convert("RGBa").resize(size, Image.Resampling.HAMMING).convert("RGBA")
    canvas = Image.new("RGBA", (SIDE, SIDE))
    canvas.paste(small, (round(centre[0] - size[0] / 2), round(centre[1] - size[1] / 2)))
    array = np.array(canvas)
    if jitter:
        gain = rng.uniform(0.7, 1.4) * rng.uniform(0.85, 1.15, 3)
        shift = rng.uniform(-25, 40)
        colours = array[..., :3] * gain + shift
        if rng.random() < 0.15:
            colours = colours.mean(axis=2, keepdims=True) + rng.uniform(-20, 20, 3)
        array[..., :3] = np.clip(colours, 0, 255)
    return array


def shaded(ground, alpha, rng):
    """The ground with a soft shadow of an object."""
    rows = np.flatnonzero((alpha > 127).any(axis=1))
    columns = np.flatnonzero((alpha > 127).any(axis=0))
    if not len(rows):
        return ground
    shadow = Image.new("L", (SIDE, SIDE))
    wide, high = np.ptp(columns) + 1, np.ptp(rows) + 1
    if rng.random() < 0.6:  # on the floor: the silhouette, flattened, or an ellipse
        flat = Image.fromarray(alpha).crop((columns[0], rows[0], columns[-1] + 1, rows[-1] + 1))
        flat = flat.resize(
            (3 + int(wide * rng.uniform(0.9, 1.3)), 3 + int(high * rng.uniform(0.1, 0.5)))
        )
        shift = rng.uniform(-0.3, 0.3) * wide
        shadow.paste(
            flat, (int(columns[0] + shift), int(rows[-1] - flat.height * rng.uniform(0.5, 0.9)))
        )
    else:  # on a wall behind
        shadow.paste(Image.fromarray(alpha), tuple(int(v) for v in rng.uniform(-12, 12, 2)))
    shadow = shadow.filter(ImageFilter.GaussianBlur(rng.uniform(1, 8)))
    return ground * (1 - rng.uniform(0.15, 0.75) * (np.asarray(shadow)[..., None] / 255))


def over(ground, layer):
    alpha = layer[..., 3:] / np.float32(255)
    return ground * (1 - alpha) + layer[..., :3] * alpha


def part_of(scene, rng):
    """A part of an image with the whole object in it: image and mask, [SIDE, SIDE, ...]."""
    left, top, right, bottom = box_of(scene)
    height, width = scene.shape[:2]
    box = [rng.uniform(0, left), rng.uniform(0, top), rng.uniform(right, width)]
    box.append(rng.uniform(bottom, height))
    # One by one: resized together, the colours would be multiplied by the mask.
    planes = [Image.fromarray(np.ascontiguousarray(scene[..., c])) for c in range(4)]
    part = np.dstack([plane.resize((SIDE, SIDE), BILINEAR, box) for plane in planes])
    if rng.random() < 0.5:
        part = part[:, ::-1]
    return part[..., :3], part[..., 3] > 127


def photographed(image, rng):
    """An image with the effects of a camera, uint8."""
    image = np.clip(image, 0, 255).astype(np.uint8)
    image = change_light(image, rng, 0.7, 0.15)
    image = degrade(image, rng, 1.2, 0.03)
    return compress(image, rng.uniform(25, 95)) if rng.random() < 0.6 else image


def composite(number, objects, backgrounds, scenes=()):
    """Image uint8 [SIDE, SIDE, 3] and mask bool [SIDE, SIDE] of the central object."""
    rng = np.random.default_rng((7, number))
    if scenes and rng.random() < 0.2:
        image, mask = part_of(scenes[rng.integers(len(scenes))], rng)
        return photographed(image, rng), mask
    aspect = np.exp(rng.uniform(-0.55, 0.55))  # width over height of the photo before it is resized

    def draw():
        group = objects[rng.integers(len(objects))]
        return group[rng.integers(len(group))]

    image = ground_of(backgrounds, rng, aspect).astype(np.float32)
    side = SIDE * (0.25 + 0.7 * rng.random() ** 0.7)
    reach = (SIDE - 0.9 * side) / 2 * 0.6
    centre = SIDE / 2 + rng.uniform(-reach, reach, 2)
    main = placed(draw(), rng, side, centre, aspect, rng.random() < 0.7)
    others = rng.choice([0, 1, 2, 3], p=[0.6, 0.2, 0.1, 0.1])
    for _ in range(others):
        angle, far = rng.uniform(0, 2 * np.pi), SIDE * rng.uniform(0.42, 0.65)
        at = SIDE / 2 + far * np.array([np.cos(angle), np.sin(angle)])
        other = placed(draw(), rng, side * rng.uniform(0.3, 1.0), at, aspect, True)
        if rng.random() < 0.5:
            image = shaded(image, other[..., 3], rng)
        image = over(image, other)
    if rng.random() < 0.65:
        image = shaded(image, main[..., 3], rng)
    image = over(image, main)
    mask = main[..., 3] > 127
    if rng.random() < 0.1:  # something in front of an edge of the object
        at = centre + rng.choice([-0.5, 0.5], 2) * side
        front = placed(draw(), rng, side * rng.uniform(0.2, 0.5), at, aspect, True)
        image = over(image, front)
        mask &= front[..., 3] < 128
    return photographed(image, rng), mask


def prepare(arguments):
    """Loads what `encoded` needs, in the process that makes batches."""
    global _sources, _encode
    groups = objects_of(arguments.objects, "train")
    backgrounds = backgrounds_of(arguments.backgrounds)
    scenes = [s for f in arguments.scenes for s in samples_of(f, "train") if s[..., 3].any()]
    _sources = groups, backgrounds, scenes
    objects = sum(map(len, groups))
    print(f"{objects} objects, {len(backgrounds)} backgrounds, {len(scenes)} scenes", flush=True)
    net = efficientnet.EfficientNetLite0()
    params = read_mask_network(arguments.init)[0][efficientnet.NAME]
    _encode = jax.jit(lambda image: net.apply({"params": params}, image / jnp.float32(255)))


def encoded(step):
    """The maps of a batch of composites, float16, and their masks."""
    made = [composite(BATCH * step + i, *_sources) for i in range(BATCH)]
    image, mask = (np.stack(x) for x in zip(*made, strict=True))
    return [np.asarray(x, np.float16) for x in _encode(image)], mask


def batches(arguments):
    """The batches, made by another process ahead of their use."""
    spawn = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(1, spawn, prepare, (arguments,)) as pool:
        ahead = collections.deque()
        for step in range(arguments.first, arguments.first + arguments.steps):
            ahead.append(pool.submit(encoded, step))
            if len(ahead) > 8:
                yield ahead.popleft().result()
        for future in ahead:
            yield future.result()


def loss_of(logits, target):
    """Cross entropy plus soft Dice, per image; the target is the share of each cell's pixels."""
    entropy = optax.sigmoid_binary_cross_entropy(logits, target).mean(axis=(1, 2))
    p = jax.nn.sigmoid(logits)
    common, total = (p * target).sum(axis=(1, 2)), (p + target).sum(axis=(1, 2))
    return (entropy + 0.5 * (1 - (2 * common + 1) / (total + 1))).mean()


def train(arguments):
    """Trains the decoder and writes the network; each batch is used about twice."""
    initial, decoder = read_mask_network(arguments.init)[0], mask_net.MaskDecoder()
    params = initial["decoder"]
    if arguments.new_decoder:
        encoder, image = efficientnet.EfficientNetLite0(), jnp.zeros((1, SIDE, SIDE, 3))
        maps = jax.eval_shape(encoder.apply, {"params": initial[efficientnet.NAME]}, image)
        maps = [jnp.zeros(each.shape) for each in maps]
        params = decoder.init(jax.random.key(0), maps)["params"]
    rate = optax.warmup_cosine_decay_schedule(
        0, arguments.rate, min(100, arguments.steps), 2 * arguments.steps, 1e-5
    )
    optimiser = optax.chain(optax.clip_by_global_norm(1.0), optax.adamw(rate, weight_decay=1e-4))

    @jax.jit
    def step(params, state, maps, mask):
        target = mask.reshape(BATCH, SIDE // 2, 2, SIDE // 2, 2).astype(jnp.float32).mean((2, 4))

        def objective(params):
            logits = decoder.apply({"params": params}, [x.astype(jnp.float32) for x in maps])
            found, true = logits > 0, target > 0.5
            iou = (found & true).sum((1, 2)) / jnp.maximum((found | true).sum((1, 2)), 1)
            return loss_of(logits, target), iou.mean()

        (value, iou), gradient = jax.value_and_grad(objective, has_aux=True)(params)
        updates, state = optimiser.update(gradient, state, params)
        return optax.apply_updates(params, updates), state, value, iou

    state, rows, kept = optimiser.init(params), [], []
    rng = np.random.default_rng(0)
    for number, new in enumerate(batches(arguments), 1):
        kept.append(new)
        again = kept.pop(rng.integers(len(kept))) if len(kept) > 60 else new
        for maps, mask in (new, again):
            params, state, value, iou = step(params, state, maps, mask)
        rows.append((float(value), float(iou)))
        if number % 25 == 0:
            loss, iou = np.mean(rows[-25:], axis=0)
            print(
                f"{number} of {arguments.steps} batches: loss {loss:.3f}, IoU {iou:.3f}", flush=True
            )
    figures = {"composites": BATCH * (arguments.first + arguments.steps)}
    params = {**initial, "decoder": params}
    texts = {"figures": figures, "sources": read_sources(arguments.sources)}
    texts = {name: json.dumps(value) for name, value in texts.items()}
    write_arrays(arguments.out, FORMAT, named_leaves({"params": params}), texts, "float16")


def measure(arguments):
    """Prints the IoU of the masks found on composites and on photos, and their certainty."""
    objects = objects_of(arguments.objects, "validation")
    backgrounds = backgrounds_of(arguments.backgrounds)
    cases = {"composites": [composite(10**9 + i, objects, backgrounds) for i in range(200)]}
    for folder in arguments.photos:
        cases[folder] = rows = []
        for path in sorted(pathlib.Path(folder).glob("*.jpg")):
            read = photo.read_photo(path)
            rows.append(
                (read.image, photo.read_mask(path.with_name(f"{path.stem}_mask.png"), read))
            )
    for name, pairs in cases.items():
        found = [masks.probabilities(image) for image, _ in pairs]
        sure = np.array([masks.certainty(p) for p in found])
        iou = np.array(
            [
                masks.mask_iou(masks.enlarged(p, mask.shape), mask)
                for p, (_, mask) in zip(found, pairs, strict=True)
            ]
        )
        kept = sure >= masks.LEAST_CERTAINTY
        print(
            f"{name}: {len(iou)} images, IoU {iou.mean():.3f}; certain {kept.mean():.0%}, IoU of "
            f"these {iou[kept].mean():.3f}, below .5 {(iou[kept] < 0.5).sum() / len(iou):.1%}"
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    for action in (train, measure):
        command = commands.add_parser(action.__name__)
        command.set_defaults(action=action)
        command.add_argument("--objects", nargs="+", required=True)
        command.add_argument("--backgrounds", nargs="+", required=True)
        if action is train:
            command.add_argument("--scenes", nargs="*", default=[])
            command.add_argument("--sources", required=True, help="JSON file: data and licences")
            command.add_argument("--steps", type=int, default=720)
            command.add_argument("--rate", type=float, default=2e-3)
            command.add_argument("--init", default=FILE, help="mask network to continue from")
            command.add_argument(
                "--new_decoder", action="store_true", help="only its encoder stays"
            )
            command.add_argument("--first", type=int, default=0, help="number of the first batch")
            command.add_argument("--out", required=True)
        else:
            command.add_argument("--photos", nargs="*", default=["docs/photos"])
    arguments = parser.parse_args()
    arguments.action(arguments)


if __name__ == "__main__":
    main()
