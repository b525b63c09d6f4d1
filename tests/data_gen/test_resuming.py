"""Jobs that are killed, resumed and tried again. Random samples replace the renderer."""

import dataclasses
import functools
import multiprocessing.connection
import os
import pathlib
import shutil
import subprocess

import numpy as np
import pytest
from helpers import drawn_solids as solids
from helpers.refusals import refused
from helpers.solid_models import contents

from data_gen import job, settings
from data_gen.catalogues.choosing import Choice
from data_gen.catalogues.entry import FRACTIONS, Catalogue, Entry, split_of
from data_gen.engine import Variant
from data_gen.render_model import Context, line_of, model_seed
from psgn_jax.data import shards
from psgn_jax.data.codec import encode
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.manifest import load_manifest
from psgn_jax.system import processes
from psgn_jax.system.files import write_atomic
from psgn_jax.system.locks import TakenError

OPTIONS = settings.parse({"views": 1, "models_per_shard": 3})
TEN = [f"m{k}" for k in range(10)]


def listed(
    names, split=lambda name: "test" if name[-1] in "37" else "train", fractions=None, file=None
):
    """A catalogue of given names."""
    find = file and (lambda: file)
    entries = [Entry(n, "thing", split(n), lambda: None, find_file=find) for n in names]
    return Catalogue("listed", entries, fractions)


@functools.cache
def record_of(model_id, category):
    rng = np.random.default_rng(model_seed(0, "listed", model_id) % 2**31)
    solid = solids.RANDOM["box"](rng)
    sample = solids.draw(solid, rng, image_size=(16, 24), num_points=50, model_id=model_id)
    return encode(dataclasses.replace(sample, category=category))


@pytest.fixture(autouse=True, scope="module")
def no_renderer():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(job, "choose_variant", lambda _: (Variant("none"), ""))
        yield


def make(out, names, *, options=OPTIONS, stop_after=None, first=None, failing=None, **more):
    """Does a job, which stops after a number of models; returns the names of those it made, too.

    `failing` has the statuses of models without samples. `first` is called before the first model.
    """
    made, failing = [], failing or {}

    def render(tasks, context):
        for index, entry in tasks:
            if len(made) == stop_after:
                raise KeyboardInterrupt
            if first and not made:
                first()
            made.append(entry.model_id)
            line, data = line_of(entry, failing.get(entry.model_id, "ok"), "its name"), []
            if line["status"] == "ok":
                line |= {"reason": "", "samples": 1}
                data = [record_of(entry.model_id, entry.category)]
            yield shards.Result(index, line, {entry.split: data})

    source = names if isinstance(names, Catalogue) else listed(names)
    summary = job.render_catalogue(source, out, options, render=render, **more)
    return summary, sorted(made)


def models_of(folder):
    readers = [RecordReader(folder, split) for split in load_manifest(folder).splits()]
    for reader in readers:
        reader.verify()
    return sorted(sample.model_id for reader in readers for sample in reader)


@pytest.fixture(scope="module")
def once(no_renderer, tmp_path_factory):
    """The ten models, rendered at once."""
    out = tmp_path_factory.mktemp("growing") / "once"
    make(out, TEN)
    return out


DEEP = "[" * 200_000


def test_what_is_damaged_is_refused_or_made_again(once, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / shards.JOB).write_text(DEEP)  # of a call that was killed before it wrote a manifest
    with pytest.raises(KeyboardInterrupt):
        make(out, TEN, stop_after=7)  # blocks of 3 and 2, and 2 models of the next one
    (out / shards.WORK / "0.block").write_text(DEEP)
    assert make(out, TEN)[1] == ["m4", "m5", "m6", "m8", "m9"]
    assert contents(out) == contents(once)
    (damaged,) = (s.file for s in load_manifest(out).shards if s.split == "test")
    (out / damaged).write_bytes(b"no shard")
    assert make(out, TEN)[1] == ["m3", "m7"]
    assert contents(out) == contents(once)
    lines = (out / shards.REPORT).read_text()
    wrong = [
        lines.replace(*pair) for pair in (('"split"', '"s"'), ('"reason": "', '"reason": 1, "'))
    ]
    for text in (DEEP, "5\n", '{"model_id": 5}\n', "\xff", *wrong):
        (out / shards.REPORT).write_bytes(text.encode("latin1"))
        with refused(ValueError, shards.REPORT):
            make(out, TEN)
    (out / shards.REPORT).unlink()
    os.mkfifo(out / shards.REPORT)
    with refused(ValueError, shards.REPORT, "named pipe"):
        make(out, TEN)
    (out / shards.REPORT).unlink()
    (out / shards.REPORT).write_text(lines)
    for text in (DEEP, "[]", "{", '{"job": 3}'):
        (out / shards.JOB).write_text(text)
        with refused(shards.OtherSettingsError, shards.JOB):
            make(out, TEN)


def test_failed_models_are_tried_again_if_their_file_has_changed(once, tmp_path):
    out, mesh = tmp_path / "out", tmp_path / "mesh"
    bad = {"m1": "refused", "m5": "refused"}
    catalogue = listed(TEN, file=mesh)

    def seen_by_others():
        assert models_of(out) == [name for name in TEN if name not in bad]
        # Calls that see a complete data set leave a retry alone.
        for part in ((0, 1), (0, 2)):
            assert make(out, listed(TEN), part=part)[0].complete

    mesh.write_text("1")
    summary, _ = make(out, catalogue, failing=bad)
    assert {x["model_id"] for x in summary.lines if "file_crc32" in x} == set(bad)
    before = contents(out)
    os.utime(mesh, (0, 0))
    assert make(out, catalogue)[1] == []
    mesh.unlink()
    assert make(out, catalogue)[1] == []
    mesh.write_text("2")
    assert make(out, listed(TEN))[1] == make(out, catalogue, part=(0, 2))[1] == []
    assert make(out, catalogue, failing=bad)[1] == ["m0", "m1", "m2", "m4", "m5", "m6"]
    assert contents(out) == before
    assert make(out, catalogue)[1] == []
    mesh.write_text("3")
    with pytest.raises(KeyboardInterrupt):
        make(out, catalogue, stop_after=3)
    assert make(out, catalogue, first=seen_by_others)[1] == ["m4", "m5", "m6"]
    assert contents(out) == contents(once)


def test_two_processes_do_not_do_the_same_part(once, tmp_path):
    out = tmp_path / "out"

    def again():
        for part, *names in (((0, 2), os.getpid(), "0/2"), ((0, 1), "2 parts", 1)):
            with refused(TakenError, *names):
                make(out, TEN, part=part)

    make(out, TEN, part=(0, 2), first=again)
    assert make(out, TEN, part=(1, 2))[0].complete
    assert contents(out) == contents(once)


def test_a_small_set_has_all_splits(tmp_path, caplog):
    def hashed(fractions):
        names = [f"n{k}" for k in range(5)]
        return listed(names, lambda name: split_of(name, fractions), fractions)

    def splits_of(name):
        lines = shards.read_report(tmp_path / name)
        return {line["model_id"]: line["split"] for line in lines}

    five = hashed(FRACTIONS)
    assert {e.split for e in five.models} == {"train"}
    make(tmp_path / "five", five)
    found = splits_of("five")
    assert sorted(found.values()) == ["test", "train", "train", "train", "validation"]
    # The same in parts; what the options exclude stays empty.
    for part in ((1, 2), (0, 2)):
        make(tmp_path / "parts", five, part=part)
    assert contents(tmp_path / "parts") == contents(tmp_path / "five")
    make(tmp_path / "all", hashed((1.0, 0.0, 0.0)))
    assert set(splits_of("all").values()) == {"train"}
    caplog.clear()
    moved = [name for name, split in found.items() if split != "train"]
    make(tmp_path / "refused", five, failing=dict.fromkeys(moved, "refused"))
    assert "3 in 'train', 0 in 'validation', 0 in 'test'" in caplog.text


class Killed(BaseException):
    pass


@pytest.mark.parametrize("stride", [9, pytest.param(1, marks=pytest.mark.slow)])
def test_a_kill_at_any_step_leaves_the_old_or_the_new_state(stride, once, tmp_path, monkeypatch):
    failing = {"m1": "timeout", "m7": "unreadable"}
    assert make(tmp_path / "failed", TEN, failing=failing)[0].exit_code == 1
    before = models_of(tmp_path / "failed")
    write, rename, unlink = write_atomic, pathlib.Path.replace, pathlib.Path.unlink
    left = [0]

    def counted(function):
        def call(*args, **kwargs):
            left[0] -= 1
            if left[0] == 0:
                raise Killed
            return function(*args, **kwargs)

        return call

    for steps in range(1, 200, stride):
        out = tmp_path / f"killed-{steps}"
        shutil.copytree(tmp_path / "failed", out)
        with monkeypatch.context() as patch:
            patch.setattr(shards, "write_atomic", counted(write))
            patch.setattr(pathlib.Path, "replace", counted(rename))
            patch.setattr(pathlib.Path, "unlink", counted(unlink))
            left[0] = steps
            try:
                made = make(out, TEN)[1]
            except Killed:
                pass
            else:
                assert steps > 12
                assert made == ["m0", "m1", "m2", "m3", "m7"]  # the blocks of those that failed
                break
        assert models_of(out) in (before, TEN)
        (out / ".left.0123abcd.tmp").touch()  # of a process that was killed while it wrote
        make(out, TEN)
        assert contents(out) == contents(once)


def test_what_has_changed_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(job, "load_maps", lambda *_: None)
    lit = []
    for name, files in (("one", ["a.hdr", "._a.hdr"]), ("two", ["a.hdr"]), ("three", ["b.hdr"])):
        (tmp_path / name).mkdir()
        for file in files:
            (tmp_path / name / file).write_text(file)
        light = {"source": "folder", "folder": str(tmp_path / name)}
        lit.append(settings.parse({"models_per_shard": 3, "light": light}))
    six, one = TEN[:6], {"options": lit[0]}
    moved = listed(six, split=lambda name: "train")
    make(tmp_path / "out", six, **one)
    with pytest.raises(KeyboardInterrupt):
        make(tmp_path / "begun", six, stop_after=1, **one)
    for folder in ("out", "begun"):
        for models, options, *names in (
            (six, OPTIONS, "light.folder"),
            (six, lit[2], "light.folder"),
            (six, dataclasses.replace(lit[0], views=2), "views", "4 before", "2 now"),
            (["m0", "m3", "m4", "m5"], lit[0], "2 of its 6 models", "'m1'", "'m2'", "data.path="),
            (TEN, lit[0], "0 of its 6", "4 are new"),
            (moved, lit[0], "'m3', 'thing', test"),
        ):
            with refused(shards.OtherSettingsError, folder, *names):
                make(tmp_path / folder, models, options=options)
    with refused(shards.OtherSettingsError, "limit", "0 before", "2 now"):
        make(tmp_path / "out", TEN, choice=Choice(limit=2), **one)
    assert make(tmp_path / "out", six, options=lit[1])[1] == []  # the same map elsewhere
    assert models_of(tmp_path / "out") == six


def test_a_worker_whose_parent_was_killed_at_the_start_ends_in_silence():
    workers = []
    for given in (False, True):
        ours, theirs = multiprocessing.connection.Pipe()
        with theirs:
            command = processes.python("data_gen.pool", str(theirs.fileno()))
            pipes = {"pass_fds": [theirs.fileno()], "stderr": subprocess.PIPE}
            workers.append(subprocess.Popen(command, **pipes))
        if given:
            ours.send(Context(OPTIONS, "test", Variant("scalar_rgb"), None))
        ours.close()
    for worker in workers:
        assert worker.communicate(timeout=100)[1] == b""
        assert worker.returncode == 0
