import functools
import json
import os
import platform
import subprocess
import sys
import time

import numpy as np
import pytest
from helpers import processes
from helpers.commands import ROOT, psgn_each
from helpers.obj_text import CUBE, FACES
from helpers.refusals import check_message, refused
from helpers.solid_models import SMALL, contents, model_of, squares, view

from data_gen import cameras, engine, job, lights, pool, settings
from data_gen.catalogues import shapes
from data_gen.catalogues.entry import Catalogue, Entry
from data_gen.catalogues.open_catalogue import open_catalogue
from data_gen.engine import Variant, choose_variant, has_mitsuba
from data_gen.environment_maps import load_map, load_maps
from data_gen.mesh import Material
from data_gen.photograph import trace
from data_gen.picture import Mesh, Scene, render
from data_gen.render_model import Context
from data_gen.settings import Settings
from data_gen.surroundings import Surroundings
from psgn_jax.config import structured
from psgn_jax.data import camera as project_camera
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.manifest import load_manifest

pytestmark = pytest.mark.skipif(not has_mitsuba(), reason="Mitsuba is not installed")

CONFIG = ROOT / "data_gen" / "config.py"


def flat_light():
    return lights.Lights(
        directions=np.array([[0, 0, 1]], np.float32), colours=np.zeros((1, 3), np.float32),
        sky=np.ones(3, np.float32), ground=np.ones(3, np.float32), specular=0.0, darkest=0.0,
    )  # fmt: skip


def shot(model, camera, **options):
    return render(Scene(Mesh(model), camera, flat_light()), **options)


def test_depth_and_mask_are_those_of_a_sphere(started):
    model = model_of(shapes.ball(0.8, 0.8, 0.8, 96).at(z=0.4))
    camera = view(70.0, roll=10.0)
    picture = shot(model, camera)
    seen = project_camera.back_project(picture.depth, camera.intrinsics, camera.extrinsics)
    np.testing.assert_allclose(np.linalg.norm(seen - [0, 0, 0.4], axis=1), 0.4, atol=2e-3)
    pixels, _ = cameras.project(model.vertices @ camera.rotation.T, camera)
    assert project_camera.inside_mask(pixels, picture.mask, 1).all()
    assert (picture.image[~picture.mask] == 191).all()


def test_holes_show_what_is_behind_and_glass_is_part_of_the_object(started):
    texture = np.full((4, 4, 4), 255, np.uint8)
    texture[:, :2, 3] = 0
    holed = Material(diffuse=(1, 0, 0), texture=texture)
    green = Material(diffuse=(0, 1, 0))
    near, far = (0.4, 0.4, holed), (-0.4, 0.15, green)
    camera = view(elevation=10.0)
    picture = shot(squares(near, far), camera)
    colours = {tuple(c) for c in picture.image[picture.mask].tolist()}
    assert {(255, 0, 0), (0, 255, 0)} <= colours
    behind = (picture.image == [0, 255, 0]).all(axis=-1)
    assert picture.depth[behind].min() > picture.depth[(picture.image == [255, 0, 0]).all(-1)].max()
    # A hole with nothing behind it is background.
    alone = shot(squares(near), camera)
    assert 0 < alone.mask.sum() < 0.7 * shot(squares((0.4, 0.4, green)), camera).mask.sum()
    # Glass tints the surfaces behind it, and depth is that of the glass.
    glass = Material(diffuse=(0, 0, 1), opacity=0.5)
    picture = shot(squares((0.4, 0.4, glass), far), camera)
    assert (picture.image[picture.mask] == [0, 128, 128]).all(axis=1).any()
    assert np.ptp(picture.depth[picture.mask]) < 0.3


@pytest.mark.parametrize("toward", [(0.9, 0.3), (0.0, -0.9)])
def test_photos_have_the_light_where_local_shading_has_it(started, toward):
    mesh = Mesh(model_of(shapes.ball(0.8, 0.8, 0.8).at(z=0.4)))
    light = np.array([*toward, 0.3])
    light /= np.linalg.norm(light)
    radiance = np.exp(20 * (lights.directions_of(lights.MAP_SIZE) @ light - 1))
    radiance = np.repeat(radiance[..., None], 3, axis=-1)
    found = lights.reduce(radiance, lights.LightSettings(count=1), ambient=0.1, exposure=1.0)
    shown = Scene(mesh, view(azimuth=40.0), found)
    local = render(shown)
    traced, _ = trace(shown, local, Surroundings(radiance), None, rays=4, seed=0)
    both = np.stack([local.image[local.mask].mean(axis=1), traced[local.mask].mean(axis=1)])
    assert np.corrcoef(both)[0, 1] > 0.8


def test_textures_are_upright_and_photos_have_the_same_holes(started):
    texture = np.full((16, 16, 4), 255, np.uint8)
    texture[..., :3] = (0, 0, 255)
    texture[:8, :, :3] = (255, 0, 0)  # red on top
    texture[:, :4, 3] = 0  # a hole on the left
    mesh = Mesh(squares((0, 0.5, Material(diffuse=(1, 1, 1), texture=texture))))
    shown = Scene(mesh, view(elevation=0.0), flat_light())
    local = render(shown)
    around = Surroundings(np.ones((*lights.MAP_SIZE, 3)))
    traced, opacity = trace(shown, local, around, None, rays=4, seed=0)
    rows = np.flatnonzero(local.mask[:, 32])[1:-1]
    upper, lower = rows[: len(rows) // 2 - 1], rows[len(rows) // 2 + 1 :]
    for image in (local.image.astype(float), traced):
        assert (image[upper, 32, 0] > 2 * image[upper, 32, 2]).all()
        assert (image[lower, 32, 2] > 2 * image[lower, 32, 0]).all()
    columns = np.flatnonzero(local.mask[rows[0]])
    assert 32 - columns.min() < columns.max() - 32  # -y and u = 0 are on the left
    assert ((opacity[..., 0] > 0.5) == local.mask).mean() > 0.97


def test_environment_maps_of_a_folder(started, tmp_path):
    values = np.ones((64, 128, 3), np.float32)
    values[8:12, 32:40] = 256  # near the zenith, at a quarter of the way round
    engine.mi.Bitmap(values).write(str(tmp_path / "a sky.hdr"))
    variant = Variant("scalar_rgb")
    (found,) = load_maps(str(tmp_path), variant, lights.MAP_SIZE)
    assert found.shape == (*lights.MAP_SIZE, 3)
    np.testing.assert_allclose(found[4:6, 16:20], 256)
    np.testing.assert_allclose(np.median(found), 1)
    engine.mi.Bitmap(values[:, :64]).write(str(tmp_path / "ball.hdr"))
    with refused(ValueError, "ball.hdr"):
        load_map(str(tmp_path / "ball.hdr"), lights.MAP_SIZE)


def options(**changes):
    return settings.parse({**SMALL, **changes})


SOURCE = "chair=2,table=2,couch=1"


@pytest.fixture(scope="session")
def whole(tmp_path_factory, here):
    """A data set rendered in this process without interruption."""
    out = tmp_path_factory.mktemp("render") / "whole"
    source = open_catalogue("procedural", SOURCE)
    return out, job.render_catalogue(source, out, options(), render=here)


def test_data_set_is_sound(whole):
    out, summary = whole
    assert (summary.exit_code, summary.samples, summary.statuses) == (0, 5, {"ok": 5})
    models = {e.model_id: e for e in open_catalogue("procedural", SOURCE).models}
    names = set()
    for split in load_manifest(out).splits():
        for sample in RecordReader(out, split):
            names.add(sample.model_id)
            assert sample.image.shape == (48, 64, 3)
            assert sample.points.shape == (600, 3)
            assert sample.occupancy.any()
            pixels, _ = project_camera.project(sample.points, sample.intrinsics, sample.extrinsics)
            assert project_camera.inside_mask(pixels, sample.mask, 1).mean() > 0.94
            # The rotation is from the model's frame to the sample's frame.
            rotation = np.array(json.loads(sample.extra)["rotation"])
            turned = models[sample.model_id].load().vertices @ rotation.T
            np.testing.assert_allclose(turned.max(0), sample.points.max(0), atol=0.15)
    lines = [json.loads(text) for text in (out / job.REPORT).read_text().splitlines()]
    assert {line["model_id"] for line in lines} == names
    assert all(line["views"][0]["inside"] > 0.94 for line in lines)


def test_killed_and_parted_gives_the_same_bytes(whole, here, tmp_path):
    out = tmp_path / "parts"
    flags = {f"--config.{key}={value}" for key, value in structured.flatten(options()).items()}
    same = {f"--config.{key}={value}" for key, value in structured.flatten(Settings()).items()}
    command = [
        sys.executable, str(ROOT / "data_gen" / "render.py"), "--catalogue=procedural",
        f"--source={SOURCE}", f"--out={out}", *(flags - same), "--config.job.workers=2",
    ]  # fmt: skip
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(command, **quiet, env=environment)
    assert processes.wait_until(lambda: list(out.glob(".work/*.[bi]*")))
    process.kill()
    process.wait()
    assert not load_manifest(out, allow_incomplete=True).complete
    source = open_catalogue("procedural", SOURCE)
    first = job.render_catalogue(source, out, options(), part=(1, 2), render=here)
    assert first.exit_code == 3
    second = job.render_catalogue(source, out, options(), part=(0, 2))
    assert second.exit_code == 0
    assert contents(out) == contents(whole[0])
    assert not (out / ".work").exists()


def test_refused_models_have_reasons_and_do_not_stop_the_job(here, write, tmp_path):
    cube, latin = CUBE + FACES, os.fsdecode(b"latin\xe9")  # the latter is no UTF-8
    for name, text in {"café": cube, "empty": "", latin: cube}.items():
        write(f"meshes/good/{name}.obj", text)
    source = open_catalogue("folder", tmp_path / "meshes")
    summary = job.render_catalogue(source, tmp_path / "out", options(), render=here)
    assert summary.exit_code == 1
    reasons = {line["model_id"]: line["reason"] for line in summary.lines}
    assert reasons.pop("good/empty.obj")
    assert reasons == {"good/café.obj": "", "good/latin\\xe9.obj": ""}


def test_a_wrong_light_marks_no_folder_and_a_wrong_library_is_no_variant(tmp_path, monkeypatch):
    source = open_catalogue("procedural", "chair=1")
    (tmp_path / "torn.hdr").write_bytes(b"#?RADIANCE\ntorn")
    wrong = {"source": "folder", "folder": str(tmp_path)}
    with refused(ValueError, "torn.hdr"):
        job.render_catalogue(source, tmp_path / "out", options(light=wrong))
    assert not (tmp_path / "out").exists()
    bogus = tmp_path / "libLLVM-19.so"
    bogus.write_bytes(b"no library")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(bogus))
    assert engine.llvm_candidates()[0] == str(bogus)
    monkeypatch.setattr(engine, "llvm_candidates", lambda: [str(bogus)])
    variant, message = choose_variant("auto")
    assert variant == Variant("scalar_rgb")
    assert "libllvm19" in message
    with refused(RuntimeError, "libllvm19"):
        choose_variant("llvm")


@pytest.mark.skipif((sys.platform, platform.machine()) != ("linux", "x86_64"), reason="no wheel")
def test_llvm_comes_with_the_extra_render_without_a_variable(monkeypatch):
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(engine, "_LLVM_FOLDERS", ())
    variant, message = choose_variant("llvm")
    assert (variant.name, message) == ("llvm_ad_rgb", "")
    assert variant.libllvm.endswith("lib/libLLVM.so.19.1")


# Executed in the worker: a loader must be importable there.
HOARD = """
import time
block = bytearray(7 * 10**8)
block[::4096] = b"1" * len(block[::4096])
time.sleep(60)
"""


@pytest.mark.slow
def test_crash_timeout_and_memory_end_with_their_model(tmp_path):
    limits = SMALL["job"] | {"workers": 2, "seconds_per_model": 6.0, "megabytes_per_worker": 700}
    (good,) = open_catalogue("procedural", "table=1").models
    loaders = {
        "abort": os.abort,
        "sleep": functools.partial(time.sleep, 60),
        "hoard": functools.partial(exec, HOARD),
        "good": good.load,
    }
    source = Catalogue("hostile", [Entry(name, "", "train", x) for name, x in loaders.items()])
    summary = job.render_catalogue(source, tmp_path / "out", options(job=limits))
    status = {line["model_id"]: line["status"] for line in summary.lines}
    assert status == {"abort": "crashed", "sleep": "timeout", "hoard": "memory", "good": "ok"}
    assert summary.samples == 1


def test_processes_that_cannot_start_are_told_apart_from_models(monkeypatch):
    monkeypatch.setattr(pool, "_FAILED_STARTS", 1)
    context = Context(options(), "procedural", Variant("no such variant"), None)
    with refused(RuntimeError, "worker processes"):
        list(pool.render_local([(0, open_catalogue("procedural", "table=1").models[0])], context))


def test_command_has_help_and_refuses_wrong_arguments(tmp_path):
    command = ["--catalogue=procedural", "--source=1", f"--out={tmp_path / 'out'}"]
    cases = (
        ("--shard=2/2", "--shard=2/2", "i/n"),
        ("--config.views=abc", "abc"),
        ("--config=photos", "--config=photos", "'photo'"),
        (f"--config={CONFIG}:nobody", "'nobody'"),
        # The preset sets image.shading=photo, so that only the seed is wrong.
        ("--config=photo --config.image.rays=9 --seed=3", "--seed=3", "--sample"),
        ("--exclude=lmap", "--exclude=lmap", "'lamp'"),
        # Fields may precede --config.
        ("--config.camera.aim=(7.,1.) --config=r2n2", "camera.aim=(7.0, 1.0)"),
    )
    arguments = [["render", *command, *wrong.split(" ")] for wrong, *_ in cases]
    imports = ["data_gen.catalogues.open_catalogue"]
    first, *found = psgn_each(["render", "--help"], *arguments, cwd=tmp_path, imports=imports)
    for done, (_, *names) in zip(found, cases, strict=True):
        assert done.returncode == 2
        check_message(done.stderr, "error: ", *names)
    assert not (tmp_path / "out").exists()
    assert first.returncode == 0
    for part in (str(CONFIG), "--option=first_seed=0", "--config.camera.roll='(0.0, 0.0)'"):
        assert part in first.stdout
