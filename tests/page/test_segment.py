"""Cuts and masks of the page's JavaScript, compared with SciPy, OpenCV and this package."""

import hashlib

import numpy as np
import pytest
from helpers import javascript
from PIL import Image, ImageDraw

from psgn_jax.data import masks
from psgn_jax.page.build import STATIC
from psgn_jax.portable.folder import TEMPLATES

pytestmark = pytest.mark.skipif(javascript.NODE is None, reason="no node")


@pytest.fixture(scope="module")
def modules(tmp_path_factory):
    """The modules in one folder, as the page has them."""
    folder = tmp_path_factory.mktemp("modules")
    for path in (*STATIC.glob("*.js"), *TEMPLATES.glob("*.js")):
        (folder / path.name).write_text(path.read_text())
    names = ("segment", "maxflow", "sha256", "photo")
    return {name: folder / f"{name}.js" for name in names}


def test_cuts_are_least(modules):
    """The cost of the cut equals the maximum flow that SciPy finds."""
    sparse = pytest.importorskip("scipy.sparse")
    from scipy.sparse.csgraph import maximum_flow

    width, height = 11, 9
    steps = [-width - 1, -width, -width + 1, -1, 1, width - 1, width, width + 1]
    rng = np.random.default_rng(0)
    count = width * height
    inner = [y * width + x for y in range(1, height - 1) for x in range(1, width - 1)]
    cases, flows = [], []
    for case in range(12):
        capacity = np.zeros((8, count), np.int32)
        for i in inner:
            for d, step in enumerate(steps):
                if i + step in inner:
                    capacity[d, i] = rng.integers(0, 12 if case % 2 else 3)
        terminal = np.zeros(count, np.int32)
        terminal[inner] = rng.integers(-20, 21, len(inner))
        source, sink = count, count + 1
        graph = sparse.lil_matrix((count + 2, count + 2), dtype=np.int32)
        for i in inner:
            for d, step in enumerate(steps):
                if capacity[d, i]:
                    graph[i, i + step] = capacity[d, i]
            if terminal[i] > 0:
                graph[source, i] = terminal[i]
            elif terminal[i] < 0:
                graph[i, sink] = -terminal[i]
        flows.append(maximum_flow(graph.tocsr(), source, sink).flow_value)
        cases.append((capacity, terminal))
    given = [
        {"capacity": [row.astype(np.float32) for row in c], "terminal": t.astype(np.float32)}
        for c, t in cases
    ]
    body = f"""
return input.cases.map(c => maxflow.cut({width}, {height},
  c.capacity.map(row => Float64Array.from(row)), Float64Array.from(c.terminal)));
"""
    for (capacity, terminal), flow, side in zip(
        cases, flows, javascript.node(body, modules, cases=given), strict=True
    ):
        side = np.array(side, bool)
        cost = terminal[(terminal > 0) & ~side].sum() - terminal[(terminal < 0) & side].sum()
        for d, step in enumerate(steps):
            for i in inner:
                if side[i] and not side[i + step]:
                    cost += capacity[d, i]
        assert cost == flow


def textured(seed, size=(240, 320)):
    """An object and a background, each with its own set of colours; returns image and mask."""
    rng = np.random.default_rng(seed)
    picture = Image.new("L", size[::-1])
    drawing = ImageDraw.Draw(picture)
    drawing.ellipse((70, 60, 210, 200), fill=255)
    drawing.rectangle((150, 40, 260, 120), fill=255)
    mask = np.asarray(picture) > 0
    blocks = rng.integers(0, 3, (size[0] // 8 + 1, size[1] // 8 + 1))
    blocks = blocks.repeat(8, 0).repeat(8, 1)[: size[0], : size[1]]
    colours = np.array([[200, 60, 40], [230, 150, 60], [120, 30, 30]])[blocks]
    behind = np.array([[60, 120, 70], [90, 150, 160], [40, 70, 60]])[blocks]
    image = np.where(mask[..., None], colours, behind) + rng.normal(0, 12, (*size, 3))
    return image.clip(0, 255).astype(np.uint8), mask


def photo_of(image):
    return {"rgb": image, "width": image.shape[1], "height": image.shape[0]}


def overlap(a, b):
    return (a & b).sum() / (a | b).sum()


def test_grabcut_finds_an_object_by_its_colours(modules):
    image, mask = textured(0)
    body = """
const { photo } = input, hints = segment.bandHints(photo.width, photo.height);
return [segment.grabCut(photo, hints), segment.grabCut(photo, hints)];
"""
    first, second = javascript.node(body, modules, photo=photo_of(image))
    assert first == second
    found = np.reshape(first, mask.shape).astype(bool)
    assert overlap(found, mask) > 0.97
    pytest.importorskip("cv2")
    assert overlap(found, masks.grabcut(image)) > 0.95


def test_strokes_say_what_is_object(modules):
    """Two equal discs: without strokes, both are found; a stroke removes one."""
    image, _ = textured(1)
    rows, columns = np.mgrid[:240, :320]
    discs = [(rows - 120) ** 2 + (columns - c) ** 2 < 45**2 for c in (90, 230)]
    rng = np.random.default_rng(2)
    image = np.where((discs[0] | discs[1])[..., None], (200, 60, 40), (60, 120, 170))
    image = (image + rng.normal(0, 10, image.shape)).clip(0, 255).astype(np.uint8)
    body = """
const { photo } = input, hints = segment.bandHints(photo.width, photo.height);
const both = segment.grabCut(photo, hints);
const back = both.slice();
for (let i = 0; i < back.length; i++) if (input.stroke[i]) back[i] = segment.HINT.back;
return [both, segment.grabCut(photo, back)];
"""
    both, one = (
        np.reshape(m, (240, 320)).astype(bool)
        for m in javascript.node(body, modules, photo=photo_of(image), stroke=discs[1])
    )
    assert overlap(both, discs[0] | discs[1]) > 0.97
    assert not (one & discs[1]).any()


def test_one_colour_has_no_cut(modules):
    image = np.full((60, 80, 3), 90, np.uint8)
    body = """
const { photo } = input;
const nothing = new Uint8Array(4800), band = segment.bandHints(80, 60);
return [segment.grabCut(photo, nothing), segment.grabCut(photo, band)];
"""
    none, some = javascript.node(body, modules, photo=photo_of(image))
    assert none is None
    assert some is None or len(some) == 4800


@pytest.mark.parametrize("kind", ["rendering", "studio", "large", "textured"])
def test_plain_backgrounds_as_in_python(kind, modules):
    image, mask = textured(3, (600, 803) if kind == "large" else (240, 320))
    rng = np.random.default_rng(4)
    if kind == "rendering":
        image[~mask] = 191
    elif kind != "textured":
        noise = rng.normal(0, 2, image.shape)
        image = np.where(mask[..., None], image, (228 + noise).clip(0, 255)).astype(np.uint8)
    expected = masks.plain(image)
    found = javascript.node("return segment.plain(input.photo);", modules, photo=photo_of(image))
    if kind == "textured":
        assert expected is None
        assert found is None
    else:
        np.testing.assert_array_equal(np.reshape(found, mask.shape).astype(bool), expected)


def test_a_region_of_one_colour(modules):
    image = np.full((40, 50, 3), 200, np.uint8)
    image[10:30, 20:22] = 90
    body = "return segment.region(input.photo, 5, 5, 20);"
    found = np.reshape(javascript.node(body, modules, photo=photo_of(image)), (40, 50))
    assert found.sum() == 40 * 50 - 40
    body = "return segment.region(input.photo, 20, 15, 20);"
    found = np.reshape(javascript.node(body, modules, photo=photo_of(image)), (40, 50))
    assert found.sum() == 40


@pytest.mark.parametrize("size", [0, 3, 55, 56, 63, 64, 119, 1000, 100_003])
def test_checksums(size, modules):
    data = np.random.default_rng(size).integers(0, 256, size, dtype=np.uint8)
    digest = javascript.node("return sha256.sha256(input.data);", modules, data=data)
    assert digest == hashlib.sha256(data.tobytes()).hexdigest()
