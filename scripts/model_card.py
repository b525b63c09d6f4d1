"""Writes the figures and pictures of docs/model_card.md for a network.

    python scripts/model_card.py --out docs --photos
    python scripts/model_card.py --out docs --data records/authors --data FOLDER:test ...

`--photos`: `photos.png` has a row for each photo of docs/photos: the photo; the mask that `psgn
predict` finds, with the cloud of this mask from the camera of the photo and turned by 75 degrees
about the vertical axis; then the mask `NAME_mask.png` with its cloud. `three_photos.png` and the
animation `turning.webp` show clouds and surfaces of the photos in `--readme` with given masks, and
`four_clouds.png` four clouds of the last photo, turned by 75 degrees. All clouds are in normal
form. The command prints the method and the IoU of each mask that it finds.

`--data`: we evaluate the clouds of `psgn predict` for folders of records, each with the split after
a colon (default: validation): first with the images as they are (`--frame=keep` of `psgn
evaluate`), then with the object placed in them (`--frame=place`). The metrics are means over all
samples. For both frames, `model_card_FRAME.png` shows the first `--cases` cases of the first
folder. In the card, we replace the text between `<!-- begin NAME -->` and `<!-- end NAME -->`
(weights, figures, certainty, surfaces). "certainty" has the mean distance to the true points for
each fifth of the points by their spread over the draws, "surfaces" compares clouds and surfaces,
both over at most `--most` samples of the first folder.

Clouds are coloured by height, surfaces by the photo.
"""

import argparse
import functools
import io
import pathlib
import re
import sys
import tempfile

import numpy as np
import trimesh
from PIL import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import psgn_jax
from psgn_jax.commands.evaluate import open_with_records
from psgn_jax.commands.weights import describe
from psgn_jax.data import camera, photo
from psgn_jax.data.dataset import RecordReader
from psgn_jax.evaluation import table
from psgn_jax.evaluation.report import Collector
from psgn_jax.losses.chamfer import nearest_both
from psgn_jax.prediction import masks
from psgn_jax.system.files import write_atomic
from psgn_jax.tasks.run import FRAMES, evaluate_run
from psgn_jax.viewing import spheres
from psgn_jax.weights.file import read_weights
from psgn_jax.weights.opening import weights_path

ROOT = pathlib.Path(__file__).resolve().parents[1]


def small_png(picture, largest):
    """A PNG of at most `largest` bytes, with as many colours as fit; white stays white."""
    white = (np.asarray(picture) == 255).all(axis=2)
    for colours in (255, 127, 63, 31, 15):
        palette = picture.quantize(colours)
        drawn = picture.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)
        indices = np.where(white, colours, np.asarray(drawn)).astype(np.uint8)
        small = Image.fromarray(indices, "P")
        small.putpalette([*drawn.getpalette()[: 3 * colours], 255, 255, 255])
        stream = io.BytesIO()
        small.save(stream, "PNG", optimize=True)
        if stream.tell() <= largest:
            return stream.getvalue()
    raise SystemExit(f"the picture has {stream.tell()} bytes: draw fewer cases")


# --- Photos -------------------------------------------------------------------------------------

HIGH, WIDE = 150, 200
STEPS, MILLISECONDS = 40, 90
"""Number of pictures of a turn, and the duration of a picture."""


def panel(picture, high=HIGH):
    """A picture that fits into a panel, on white."""
    framed, small = Image.new("RGB", (WIDE, high), "white"), Image.fromarray(picture)
    small.thumbnail((WIDE, HIGH), Image.Resampling.LANCZOS)
    framed.paste(small, ((WIDE - small.width) // 2, (high - small.height) // 2))
    return np.asarray(framed)


def masked(image, mask, predictor, which, title):
    """The image with the part outside the mask in blue, and the cloud from two sides."""
    prediction = predictor(image, mask)
    clouds = spheres.by_height({f"cloud, {which} mask": prediction.points[0]})
    pictures = spheres.panels(vars(prediction.view), clouds, height=HIGH)
    return {title: panel(masks.with_mask(image, mask)), **dict(list(pictures.items())[1:])}


def row(image, given, predictor):
    """The pictures of a photo by title, and the label of the mask that we found."""
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


def cloud_picture(prediction, high):
    """The cloud from the camera of the photo."""
    clouds = spheres.by_height({"cloud": prediction.points[0]})
    drawn = spheres.panels(vars(prediction.view), clouds, turns=(0,), height=high)
    return list(drawn.values())[-1]


@functools.cache
def shaded_points(prediction):
    """Many points of the textured surface, and their shaded colours."""
    mesh = prediction.surface()
    points, of_face = trimesh.sample.sample_surface(mesh, 150_000, seed=0)
    weights = trimesh.triangles.points_to_barycentric(mesh.triangles[of_face], points)[..., None]
    normals = (mesh.vertex_normals[mesh.faces[of_face]] * weights).sum(axis=1)
    uv = (mesh.visual.uv[mesh.faces[of_face]] * weights).sum(axis=1)
    texture = np.asarray(mesh.visual.material.baseColorTexture.convert("RGB"))
    last = np.array(texture.shape[1::-1]) - 1
    column, row = np.clip(np.rint([1, -1] * (uv - [0, 1]) * last).astype(int), 0, last).T
    light = 0.75 + 0.35 * np.clip(normals @ [0.48, -0.36, 0.8], 0, 1)
    colours = np.minimum(texture[row, column] * light[:, None], 255).astype(np.uint8)
    return points, colours


def surface_picture(prediction, turn, high):
    """The textured surface, drawn as many small points."""
    clouds = {"surface": shaded_points(prediction)}
    view, radius = vars(prediction.view), {"surface": 0.008}
    drawn = spheres.panels(view, clouds, turns=(turn,), height=high, radius=radius)
    return list(drawn.values())[-1]


def side_by_side(image, prediction):
    """The photo, and its cloud and surface from the camera of the photo."""
    high = 15 * HIGH // 12
    drawn = cloud_picture(prediction, high), surface_picture(prediction, 0, high)
    return np.concatenate([panel(image, high), *drawn], axis=1)


def four_clouds(photo_and_mask, predictor):
    """The photo, and four clouds of it from the side."""
    prediction = predictor(*photo_and_mask, samples=4)
    clouds = spheres.by_height({str(i): cloud for i, cloud in enumerate(prediction.points)})
    drawn = spheres.panels(vars(prediction.view), clouds, turns=(75,), height=HIGH)
    row = [panel(photo_and_mask[0]), *list(drawn.values())[1:]]
    return Image.fromarray(np.concatenate(row, axis=1))


def animation(predictions):
    """A WebP of surfaces beside each other, each turning about its vertical axis."""
    frames = []
    for turn in 360 * np.arange(STEPS) / STEPS:
        pictures = [surface_picture(each, turn, 2 * HIGH) for each in predictions]
        frames.append(Image.fromarray(np.concatenate(pictures, axis=1)))
    stream = io.BytesIO()
    options = {"duration": MILLISECONDS, "loop": 0, "quality": 70, "method": 6}
    frames[0].save(stream, "WEBP", save_all=True, append_images=frames[1:], **options)
    return stream.getvalue()


def draw_photos(predictor, out, names):
    """Writes `photos.png`, `three_photos.png` and `turning.webp`."""
    rows, chosen = [], {}
    for path in sorted((ROOT / "docs" / "photos").glob("*.jpg")):
        read = photo.read_photo(path)
        given = photo.read_mask(path.with_name(f"{path.stem}_mask.png"), read)
        if path.stem in names:
            chosen[path.stem] = read.image, predictor(read.image, given)
        if path.stem == names[-1]:
            last = read.image, given
        pictures, text = row(read.image, given, predictor)
        rows.append((path.stem, pictures))
        print(f"{path.stem}: {text}")
    three = np.concatenate([side_by_side(*chosen[name]) for name in names])
    write_atomic(out / "photos.png", small_png(spheres.sheet(rows, columns=1), 480_000))
    write_atomic(out / "three_photos.png", small_png(Image.fromarray(three), 480_000))
    write_atomic(out / "turning.webp", animation([chosen[name][1] for name in names]))
    write_atomic(out / "four_clouds.png", small_png(four_clouds(last, predictor), 480_000))


# --- Records ------------------------------------------------------------------------------------

METRICS = (
    "cd_sq_radius2",
    "cd_l1_radius",
    "emd_radius",
    "fscore",
    "aligned_cd_sq_radius2",
    "aligned_emd_radius",
)
TITLES = {"keep": "as framed", "place": "placed"}


def cells_of(data, frame, evaluation):
    """Cells of a row: data set and split, framing, number of samples, means of the metrics."""
    folder, _, split = data.partition(":")
    cells = [f"{pathlib.Path(folder).name}, {split or 'validation'}", TITLES[frame]]
    cells.append(str(len(evaluation.names)))
    for name in METRICS:
        value = float(np.mean(evaluation.metrics[name]))
        cells.append(f"{100 * value:.1f} %" if name == "fscore" else f"{value:.4f}")
    return cells


def sheet(evaluation, collector, cases):
    """PNG of the first cases: image, prediction, truth."""
    drawn = []
    for i in range(min(cases, len(collector))):
        case = collector[i]
        error = evaluation.metrics["cd_sq_radius2"][i]
        clouds = spheres.by_height({f"{error:.4f}": case["pred"], "truth": case["points"]})
        label = f"{evaluation.names[i].record} {evaluation.names[i].category}"[:22]
        drawn.append((label, spheres.panels(case, clouds, (0,), height=84)))
    return small_png(spheres.sheet(drawn, columns=4), 400_000)


def filled(text, blocks):
    """The card with the content of its blocks replaced."""
    for name, content in blocks.items():
        pattern = rf"(<!-- begin {name} -->\n).*?(<!-- end {name} -->)"
        text, count = re.subn(
            pattern, lambda m, c=content: f"{m[1]}\n{c.strip()}\n\n{m[2]}", text, flags=re.DOTALL
        )
        if count != 1:
            raise SystemExit(f"{count} blocks {name!r} in the card: expected one")
    return text


def evaluate(weights, data, frame, folder):
    """The evaluation of a data set, and its samples."""
    path, _, split = data.partition(":")
    collector = Collector(folder)
    evaluation = evaluate_run(
        open_with_records(weights, data=path),
        split=split or "validation",
        frame=frame,
        refine=True,
        out=folder / frame,
        on_batch=collector,
    )
    return evaluation, collector


def predictions(weights, data, most):
    """Samples, at most `most` of a split, and their predictions, as they are framed."""
    folder, _, split = data.partition(":")
    reader, predictor = RecordReader(folder, split or "validation"), psgn_jax.load(weights)
    for i in range(0, len(reader), -(-len(reader) // most)):
        sample = reader[i]
        yield sample, predictor(sample.image, sample.mask, frame="keep", normal_form="no")


def certainty(weights, data, most):
    """The mean spread, and distance to the truth, of each fifth of the points by spread."""
    rows = []
    for sample, cloud in predictions(weights, data, most):
        nearest, _ = nearest_both(cloud.points[0], sample.points)
        order = np.argsort(cloud.spread)
        both = cloud.spread[order], np.sqrt(nearest.distance_sq)[order]
        rows.append([[part.mean() for part in np.array_split(values, 5)] for values in both])
    spread, distance = np.mean(rows, axis=0)
    names = ["fifth of the points", "most certain", "2", "3", "4", "least certain"]
    cells = ([name, *(f"{x:.3f}" for x in row)] for name, row in (
        ("spread [radius]", spread), ("distance to the truth [radius]", distance)
    ))  # fmt: skip
    return table.markdown([names, *cells])


def surfaces(weights, data, most):
    """CD, F-score at .05 and outline of clouds and of 4,096 points of their surfaces."""
    rows = []
    for sample, found in predictions(weights, data, most):
        mesh = found.surface()
        for points in (found.points[0], trimesh.sample.sample_surface(mesh, 4096, seed=0)[0]):
            there, back = nearest_both(points.astype(np.float32), sample.points[::4])
            near = [np.mean(side.distance_sq < 0.05**2) for side in (there, back)]
            cd = np.mean(there.distance_sq) + np.mean(back.distance_sq)
            rows.append([cd, 2 * near[0] * near[1] / max(sum(near), 1e-9)])
        dense, _ = trimesh.sample.sample_surface(mesh, 200_000, seed=0)
        pixels, _ = camera.project(dense, found.view.intrinsics, found.view.extrinsics)
        outline = np.zeros(found.view.mask.shape, np.bool_)
        row, column = np.clip(pixels[:, ::-1].astype(int).T, 0, np.array([outline.shape]).T - 1)
        outline[row, column] = True
        rows[-1].append(masks.mask_iou(outline, found.view.mask))
        rows[-2].append(np.nan)
    cloud, surface = np.array(rows).reshape(-1, 2, 3).mean(axis=0)
    names = ["", "CD squared [radius^2]", "F-score at .05", "IoU of outline and mask"]
    return table.markdown([
        names, ["clouds", f"{cloud[0]:.4f}", f"{cloud[1]:.3f}", ""],
        ["surfaces", f"{surface[0]:.4f}", *(f"{x:.3f}" for x in surface[1:])],
    ])  # fmt: skip


def write_card(weights, sets, out, cases, most):
    """Writes the card with its sheets."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        for data in sets:
            for frame in FRAMES:
                evaluation, collector = evaluate(weights, data, frame, pathlib.Path(name))
                rows.append(cells_of(data, frame, evaluation))
                if data == sets[0]:
                    content = sheet(evaluation, collector, cases)
                    write_atomic(out / f"model_card_{frame}.png", content)
    head = ["data", "framing", "samples", *(table.header(evaluation, name) for name in METRICS)]
    path = weights_path(weights)
    read = read_weights(path)
    blocks = {
        "weights": f"```\n{describe(read, path)}```",
        "figures": table.markdown([head, *rows]),
        "certainty": certainty(weights, sets[0], most),
        "surfaces": surfaces(weights, sets[0], most),
    }
    text = (ROOT / "docs" / "model_card.md").read_text(encoding="utf-8")
    write_atomic(out / "model_card.md", filled(text, blocks))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--weights", default="", help="file or name; default: the package's")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--photos", action="store_true", help="draw the photos")
    parser.add_argument("--readme", default="dumper,car,chair", help="photos of the README")
    parser.add_argument("--data", action="append", metavar="RECORDS[:SPLIT]")
    parser.add_argument("--cases", type=int, default=64)
    parser.add_argument(
        "--most", type=int, default=100, help="largest number of samples of the certainty"
    )
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.photos:
        predictor = psgn_jax.load(arguments.weights)
        draw_photos(predictor, arguments.out, arguments.readme.split(","))
    if arguments.data:
        write_card(
            arguments.weights, arguments.data, arguments.out, arguments.cases, arguments.most
        )


if __name__ == "__main__":
    main()
