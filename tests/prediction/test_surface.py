import dataclasses
import json
import subprocess
import tarfile

import numpy as np
import pytest
import trimesh
from helpers.commands import PHOTOS, psgn_each
from helpers.refusals import all_refused, refused
from scipy.spatial import KDTree

import psgn_jax
from data_gen.readers.load import load_model
from psgn_jax.commands import convert
from psgn_jax.data import camera
from psgn_jax.data.dataset import RecordReader
from psgn_jax.prediction.surface import SurfaceError, glb, surface_of


@pytest.fixture(scope="module")
def model():
    return psgn_jax.load()


@pytest.fixture(scope="module")
def cloud(model):
    return model(PHOTOS / "car.jpg", PHOTOS / "car_mask.png", samples=2)


@pytest.fixture(scope="module")
def mesh(cloud):
    return cloud.surface()


@pytest.fixture(scope="module")
def file(cloud, tmp_path_factory):
    path = tmp_path_factory.mktemp("surface") / "car_surface.glb"
    cloud.save_surface(path)
    return path


def closed(vertices, faces):
    vertices = np.asarray(vertices, np.float64)
    made = trimesh.Trimesh((vertices - vertices[0]) / np.ptp(vertices), faces, process=False)
    assert made.is_watertight
    assert made.is_winding_consistent
    assert made.volume > 0
    assert len(faces) <= 20_000


def camera_of(cloud):
    return np.linalg.inv(cloud.view.to_view) @ cloud.view.intrinsics, cloud.view.extrinsics


def test_a_sphere(rng):
    points = rng.normal(size=(1024, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    made = surface_of(points + 5)
    closed(*made)
    radii = np.linalg.norm(made.vertices - 5, axis=1)
    assert np.abs(radii - 1).max() < 0.12
    assert np.abs(radii.mean() - 1) < 0.03


def test_a_photo_gives_its_outline_and_its_colours(cloud, mesh):
    closed(mesh.vertices, mesh.faces)
    points = cloud.points[0][~cloud.outlier[0]]
    assert np.abs(mesh.bounds - [points.min(axis=0), points.max(axis=0)]).max() < 0.12
    dense, of_face = trimesh.sample.sample_surface(mesh, 100_000, seed=0)
    pixels, _ = camera.project(dense, *camera_of(cloud))
    shown = np.zeros(cloud.mask.shape, np.bool_)
    column, row = np.clip(pixels.astype(int), 0, np.array(shown.shape[::-1]) - 1).T
    shown[row, column] = True
    assert (shown & cloud.mask).sum() / (shown | cloud.mask).sum() > 0.93
    # The texture is the photo: the front has the colours of its pixels.
    inner = camera.inside_mask(pixels, cloud.mask) & ~camera.inside_mask(pixels, ~cloud.mask, 3)
    front = inner & (mesh.face_normals[of_face] @ cloud.view.extrinsics[2, :3] < 0)
    texture = np.asarray(mesh.visual.material.baseColorTexture.convert("RGB"))
    weights = trimesh.triangles.points_to_barycentric(mesh.triangles[of_face], dense)
    uv = (mesh.visual.uv[mesh.faces[of_face]] * weights[..., None]).sum(axis=1)
    size = np.array(texture.shape[1::-1])
    x, y = np.clip((np.column_stack([uv[:, 0], 1 - uv[:, 1]]) * size).astype(int), 0, size - 1).T
    differences = np.abs(texture[y, x].astype(int) - cloud.photo.image[row, column])[front]
    assert np.median(differences) < 8


def test_the_same_photo_and_seed_give_the_same_file(model, cloud, mesh, file):
    again = model(PHOTOS / "car.jpg", PHOTOS / "car_mask.png", samples=2)
    assert glb(again.surface()) == file.read_bytes()
    closed(again.surface(1).vertices, again.surface(1).faces)
    assert not np.array_equal(again.surface(1).vertices, mesh.vertices)
    high = cloud.surface(height=1.5)
    np.testing.assert_allclose(high.extents / mesh.extents, high.scale / mesh.scale, rtol=1e-6)
    assert high.extents[2] == pytest.approx(1.5)
    table = [(height, "height=", "1e-06") for height in (0, np.nan, 1e39, "1.5")]
    all_refused(lambda height: cloud.surface(height=height), ValueError, table)
    low = cloud.mask.copy()  # without the upper two thirds
    low[: int(np.quantile(np.nonzero(low)[0], 0.7))] = False
    cut = dataclasses.replace(cloud, mask=low)
    assert cut.surface().extents[2] < 0.5 * mesh.extents[2]
    with refused(SurfaceError, "height"):
        cut.surface(height=1.5)


def test_other_programs_read_the_file(mesh, file):
    assert file.stat().st_size < 1.2e6
    (read,) = trimesh.load(file).geometry.values()
    assert len(read.faces) == len(mesh.faces)
    np.testing.assert_allclose(read.vertices[:, [2, 0, 1]], mesh.vertices, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(read.vertex_normals, axis=1), 1, atol=1e-3)
    own = load_model(file)
    assert len(own.faces) == len(mesh.faces)
    (look,) = own.materials
    mean = np.asarray(mesh.visual.material.baseColorTexture.convert("RGB")).mean(axis=(0, 1))
    np.testing.assert_allclose(np.asarray(look.texture)[..., :3].mean(axis=(0, 1)), mean, atol=2)


def test_clouds_and_masks_of_any_kind(cloud, rng):
    points, mask, (intrinsics, extrinsics) = cloud.points[0], cloud.mask, camera_of(cloud)
    two = mask.copy()
    two[:, mask.shape[1] // 2 - 12 : mask.shape[1] // 2 + 12] = False
    line = np.zeros_like(mask)
    line[mask.shape[0] // 2] = True
    behind = extrinsics - [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 4]]
    for other, pose in (
        (two, extrinsics), (line, extrinsics), (~mask, extrinsics), (mask & False, extrinsics),
        (np.roll(mask, 60, 0), extrinsics), (mask, behind),
    ):  # fmt: skip
        closed(*surface_of(points, (other, intrinsics, pose)))
    large = np.kron(mask, np.ones((9, 9), np.bool_))
    closed(*surface_of(points, (large, np.diag([9, 9, 1]) @ intrinsics, extrinsics)))
    sheet = np.column_stack([rng.random((500, 2)), np.zeros(500)])
    for kind in (sheet, sheet[:4], sheet * 1e-12, sheet + 1e3, rng.random((16_384, 3))):
        closed(*surface_of(kind))
    closed(*surface_of(points, draws=np.full((9, 3), np.nan)))
    all_refused(surface_of, SurfaceError, [
        (np.zeros((0, 3)), "0", "4"), (np.zeros((9, 3)), "1", "4"), (np.zeros((9, 2)), "[9, 2]"),
        (np.full((9, 3), np.nan), "finite"),
    ])  # fmt: skip


def test_the_command_writes_surfaces_only_if_asked(tmp_path):
    photo = str(PHOTOS / "cup.jpg")
    without, several, wrong = psgn_each(
        ["predict", photo, "--out=a"],
        ["predict", photo, "--out=b", "--surface", "--samples=2", "--height=0.1"],
        ["predict", photo, "--out=c", "--height=0.1"],
        cwd=tmp_path,
    )
    assert (without.returncode, several.returncode, wrong.returncode) == (0, 0, 2)
    assert not list(tmp_path.glob("a/*surface*"))
    names = {"cup_0_surface.glb", "cup_1_surface.glb"}
    stated = json.loads((tmp_path / "b" / "cup.json").read_text())
    assert names <= set(stated["files"])
    assert "surface" in stated["seconds"]
    for name in names:
        (read,) = trimesh.load(tmp_path / "b" / name).geometry.values()
        assert 0.08 < read.extents[1] < 0.13  # y is up
    assert (tmp_path / "a" / "cup.xyz").read_bytes() != b""


def test_surfaces_are_as_near_to_the_true_points_as_clouds(model, authors_batches, tmp_path):
    (tmp_path / "batches").mkdir()
    (tmp_path / "batches" / "15.gz").symlink_to(authors_batches / "15.gz")
    convert.main(["authors", str(tmp_path / "batches"), str(tmp_path / "records")])
    reader, means = RecordReader(tmp_path / "records", "validation"), []
    for i in range(0, len(reader), 2):
        sample = reader[i]
        found = model(sample.image, sample.mask, frame="keep", normal_form="no")
        surface, _ = trimesh.sample.sample_surface(found.surface(), 4096, seed=0)
        for points in (found.points[0], surface.astype(np.float32)):
            # Squared distances and the F-score at .05, both ways.
            truth = sample.points[::4]
            there, back = KDTree(truth).query(points)[0], KDTree(points).query(truth)[0]
            precision, recall = (there < 0.05).mean(), (back < 0.05).mean()
            f_score = 2 * precision * recall / max(precision + recall, 1e-9)
            means.append((np.square(there).mean() + np.square(back).mean(), f_score))
    (cloud_cd, cloud_f), (cd, f_score) = np.array(means).reshape(-1, 2, 2).mean(axis=0)
    assert cd < 1.2 * cloud_cd
    assert f_score > cloud_f - 0.01


@pytest.mark.slow
def test_three_js_shows_the_file(file, tmp_path, serve, opened):
    packed = subprocess.run(
        ["npm", "pack", "--silent", "three@0.180.0"], cwd=tmp_path, capture_output=True, text=True
    )
    if packed.returncode:
        pytest.skip(f"npm: {packed.stderr.strip()[-80:]}")
    with tarfile.open(tmp_path / packed.stdout.strip()) as archive:
        archive.extractall(tmp_path, filter="data")
    (tmp_path / "car.glb").write_bytes(file.read_bytes())
    (tmp_path / "index.html").write_text("""<!doctype html><link rel="icon" href="data:,">
<canvas width="200" height="200"></canvas><script type="importmap">{"imports":
{"three": "./package/build/three.module.js", "three/": "./package/"}}</script>
<script type="module">
import * as THREE from "three"; import {GLTFLoader} from "three/examples/jsm/loaders/GLTFLoader.js";
const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(40, 1, .1, 10);
const canvas = document.querySelector("canvas");
const renderer = new THREE.WebGLRenderer({canvas, preserveDrawingBuffer: true});
scene.add(new THREE.AmbientLight("white", 3));
camera.position.set(0, .6, 3.2); camera.lookAt(0, .3, 0);
new GLTFLoader().load("car.glb", ({scene: car}) => { scene.add(car); renderer.render(scene, camera);
  const gl = renderer.getContext(), pixels = new Uint8Array(160000), sum = [0, 0, 0];
  gl.readPixels(0, 0, 200, 200, gl.RGBA, gl.UNSIGNED_BYTE, pixels); let count = 0;
  for (let i = 0; i < 160000; i += 4) if (pixels[i] + pixels[i + 1] + pixels[i + 2]) {
    count++; for (let k = 0; k < 3; k++) sum[k] += pixels[i + k]; }
  window.found = {faces: renderer.info.render.triangles, count, mean: sum.map(s => s / count)}; });
</script>""")
    page = opened(serve(tmp_path))
    page.wait_for_function("window.found")
    found = page.evaluate("window.found")
    (read,) = trimesh.load(file).geometry.values()
    assert found["faces"] == len(read.faces)
    assert found["count"] > 2000
    red, green, blue = found["mean"]
    assert red > 1.3 * green  # the car is red
    assert red > 1.3 * blue
