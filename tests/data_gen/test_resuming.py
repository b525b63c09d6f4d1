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
from helpers.small_renders import contents

from data_gen import job, pool, settings
from data_gen.catalogues.choosing import Choice
from data_gen.catalogues.entry import FRACTIONS, Catalogue, Entry, split_of
from data_gen.engine import Variant
from data_gen.render_model import Context, failure, model_seed
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


def hashed(names, fractions=FRACTIONS):
    return listed(names, lambda name: split_of(name, fractions), fractions)


def splits_of(folder):
    return {line["model_id"]: line["split"] for line in shards.read_report(folder)}


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


def make(
    out, names, *, options=OPTIONS, stop_after=None, first=None, failing=None, warnings=None, **more
):
    """Does a job, which stops after a number of models; returns the names of those it made, too.

    A model with "refused" in its name is refused; `failing` has the statuses of others, `warnings`
    their warnings. `first` is called before the first model.
    """
    made, failing = [], failing or {}

    def render(tasks, context):
        for index, entry in tasks:
            if len(made) == stop_after:
                raise KeyboardInterrupt
            if first and not made:
                first()
            made.append(entry.model_id)
            status = failing.get(entry.model_id, "refused" if "refused" in entry.model_id else "ok")
            line, data = failure(entry, status, "its name"), []
            if status == "ok":
                line |= {"reason": "", "samples": 1}
                line["views"] = [{"inside": 1.0, "depth": 0.0, "luminance": 9.0}]
                data = [record_of(entry.model_id, entry.category)]
            line["warnings"] = (warnings or {}).get(entry.model_id, [])
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


def test_each_kind_of_warning_is_logged_for_the_first_models_and_counted(tmp_path, caplog):
    warnings = ["textures missing: 'a.png', 'b.png' and 3 more", "degenerate faces dropped: 3"]
    names = [f"m{k}" for k in range(45)]
    own = {name: warnings[k > 1 :] for k, name in enumerate(names)}
    summary, _ = make(tmp_path / "out", names, warnings=own)
    assert [caplog.text.count(f"warning: m{k}: {warnings[0]}\n") for k in (0, 1, 2)] == [1, 1, 0]
    assert caplog.text.count(f": {warnings[1]}") == 40
    for line in ("2 models: textures missing", "45 models: degenerate faces dropped"):
        assert f"\n  warning in {line}" in job.text_of(summary)
    assert shards.read_report(tmp_path / "out")[0]["warnings"] == warnings


DEEP = "[" * 200_000


def test_damaged_job_folders_are_refused(once, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(once, out)
    lines = (out / shards.REPORT).read_text()
    for text in (DEEP, "5\n", '{"model_id": 5}\n', "\xff", lines.replace('"split"', '"s"')):
        (out / shards.REPORT).write_bytes(text.encode("latin1"))
        with pytest.raises(ValueError, match=r"models\.jsonl: damaged"):
            make(out, TEN)
    (out / shards.REPORT).write_text(lines)
    for text in (DEEP, "[]", "{", '{"job": 3}'):
        (out / shards.JOB).write_text(text)
        with pytest.raises(shards.OtherSettingsError):
            make(out, TEN)


def test_a_block_is_complete_or_made_again(once, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        make(out, TEN, stop_after=7)  # blocks of 3 and 2, and 2 models of the next one
    for name in (shards.JOB, "0.block"):
        (out / shards.WORK / name).write_text(DEEP)
    assert make(out, TEN)[1] == ["m4", "m5", "m6", "m8", "m9"]
    assert contents(out) == contents(once)
    # The same for a damaged shard of a complete data set.
    (damaged,) = (s.file for s in load_manifest(out).shards if s.split == "test")
    (out / damaged).write_bytes(b"no shard")
    assert make(out, TEN)[1] == ["m3", "m7"]
    assert contents(out) == contents(once)
    assert make(out, TEN)[1] == []


def test_what_failed_on_a_machine_is_tried_again(once, tmp_path):
    out = tmp_path / "out"

    def seen_by_readers():
        assert models_of(out) == [name for name in TEN if name not in ("m1", "m7")]

    summary, _ = make(out, TEN, failing={"m1": "timeout", "m7": "unreadable"})
    assert summary.statuses == {"ok": 8, "timeout": 1, "unreadable": 1}
    assert "retry what is timeout, unreadable (limits: job.seconds_" in job.text_of(summary)
    before = contents(out)
    made = make(out, TEN, failing={"m1": "timeout", "m7": "unreadable"})[1]
    assert made == ["m0", "m1", "m2", "m3", "m7"]  # their blocks
    assert contents(out) == before
    with pytest.raises(KeyboardInterrupt):
        make(out, TEN, stop_after=3)
    seen_by_readers()
    assert make(out, TEN, first=seen_by_readers)[1] == ["m3", "m7"]
    assert contents(out) == contents(once)
    assert make(out, TEN)[1] == []


def test_refused_models_are_tried_again_if_their_file_has_changed(once, tmp_path):
    out, mesh = tmp_path / "out", tmp_path / "mesh"
    bad = {"m1": "refused", "m5": "refused"}
    catalogue = listed(TEN, file=mesh)

    def seen_by_readers():
        assert models_of(out) == [name for name in TEN if name not in bad]

    mesh.write_text("1")
    summary, _ = make(out, catalogue, failing=bad)
    assert "mend refused files" in job.text_of(summary)
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
    seen_by_readers()
    assert make(out, catalogue, first=seen_by_readers)[1] == ["m4", "m5", "m6"]
    assert contents(out) == contents(once)
    # A report of an earlier version has no checksums.
    summary, _ = make(tmp_path / "old", listed(TEN), failing=bad)
    assert "mend" not in job.text_of(summary)
    assert make(tmp_path / "old", catalogue)[0].statuses == {"ok": 8, "refused": 2}


def test_calls_that_see_a_complete_set_leave_a_retry_alone(once, tmp_path):
    out, mesh = tmp_path / "out", tmp_path / "mesh"

    def others():
        for part in ((0, 1), (0, 2)):
            assert make(out, listed(TEN), part=part)[0].complete

    mesh.write_text("1")
    make(out, listed(TEN, file=mesh), failing={"m1": "refused", "m5": "refused"})
    mesh.write_text("2")
    retried = make(out, listed(TEN, file=mesh), first=others)[1]
    assert retried == ["m0", "m1", "m2", "m4", "m5", "m6"]
    assert contents(out) == contents(once)


def test_two_processes_do_not_do_the_same_part(once, tmp_path):
    out = tmp_path / "out"

    def again():
        same = rf"another process \(pid {os.getpid()}\) does part 0/2 in"
        for part, message in (((0, 2), same), ((0, 1), "into 2 parts, not 1")):
            with pytest.raises(TakenError, match=message):
                make(out, TEN, part=part)

    make(out, TEN, part=(0, 2), first=again)
    assert make(out, TEN, part=(1, 2))[0].complete
    assert contents(out) == contents(once)


def test_a_small_set_has_all_splits(tmp_path, caplog):
    names = [f"n{k}" for k in range(40)]
    five = hashed(names[:5])
    assert {e.split for e in five.models} == {"train"}
    make(tmp_path / "five", five)
    assert "a small set" in caplog.text
    found = sorted(splits_of(tmp_path / "five").values())
    assert found == ["test", "train", "train", "train", "validation"]
    # The same in parts; what the options exclude stays empty.
    for part in ((1, 2), (0, 2)):
        make(tmp_path / "parts", five, part=part)
    assert contents(tmp_path / "parts") == contents(tmp_path / "five")
    make(tmp_path / "all", hashed(names[:5], (1.0, 0.0, 0.0)))
    assert set(splits_of(tmp_path / "all").values()) == {"train"}
    caplog.clear()
    moved = [name for name, split in splits_of(tmp_path / "five").items() if split != "train"]
    make(tmp_path / "refused", five, failing=dict.fromkeys(moved, "refused"))
    assert "3 in 'train', 0 in 'validation', 0 in 'test'" in caplog.text
    assert "no samples in validation, test: mend" in caplog.text
    caplog.clear()
    make(tmp_path / "many", hashed(names))
    assert [record for record in caplog.records if record.levelname != "INFO"] == []


class Killed(BaseException):
    pass


@pytest.mark.parametrize("stride", [9, pytest.param(1, marks=pytest.mark.slow)])
def test_a_kill_at_any_step_leaves_the_old_or_the_new_state(stride, once, tmp_path, monkeypatch):
    make(tmp_path / "failed", TEN, failing={"m1": "timeout", "m7": "timeout"})
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
                make(out, TEN)
            except Killed:
                pass
            else:
                assert steps > 12
                break
        assert models_of(out) in (before, TEN)
        (out / ".left.0123abcd.tmp").touch()  # of a process that was killed while it wrote
        make(out, TEN)
        assert contents(out) == contents(once)


def test_what_has_changed_is_named(tmp_path):
    out = tmp_path / "out"
    make(out, TEN, choice=Choice(), limit=6)
    begun = tmp_path / "begun"
    with pytest.raises(KeyboardInterrupt):
        make(begun, TEN[:6], stop_after=1)
    for folder in (out, begun):
        with pytest.raises(shards.OtherSettingsError, match=r"settings \(views: 1 before, 2 now\)"):
            make(folder, TEN[:6], options=settings.parse({"models_per_shard": 3, "views": 2}))
        message = r"2 of its 6 models .*, and 0 are new \('m1', .*'m2'.*data.path=a,b reads two"
        with pytest.raises(shards.OtherSettingsError, match=message):
            make(folder, ["m0", "m3", "m4", "m5"])
        with pytest.raises(shards.OtherSettingsError, match=r"0 of its 6 .*, and 4 are new"):
            make(folder, TEN)
        moved = listed(TEN[:6], split=lambda name: "train")
        with pytest.raises(shards.OtherSettingsError, match=r"1 of its .* \('m3', 'thing', test"):
            make(folder, moved)
    with pytest.raises(shards.OtherSettingsError, match=r"limit: 6 before, 2 now"):
        make(out, TEN, limit=2)
    assert models_of(out) == TEN[:6]


def test_other_maps_are_other_settings_but_not_another_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(job, "load_maps", lambda *_: None)

    def lit(name, files):
        (tmp_path / name).mkdir(exist_ok=True)
        for file in files:
            (tmp_path / name / file).write_text(file)
        return settings.parse({"light": {"source": "folder", "folder": str(tmp_path / name)}})

    make(tmp_path / "out", TEN[:2], options=lit("one", ["a.hdr", "._a.hdr"]))
    same = lit("two", ["a.hdr"])
    assert make(tmp_path / "out", TEN[:2], options=same)[1] == []
    with pytest.raises(shards.OtherSettingsError, match=r"settings \(light.folder: 'maps "):
        make(tmp_path / "out", TEN[:2], options=lit("two", ["b.hdr"]))


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


def test_the_pool_runs_where_processes_have_no_affinity(monkeypatch):
    """As on macOS."""
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    nothing = lambda self, number, entry: shards.Result(number, {}, {})  # noqa: E731
    monkeypatch.setattr(pool.Renderer, "render", nothing)
    context = Context(OPTIONS, "listed", Variant("none"), None)
    found = pool.render_local(list(enumerate(listed(TEN).models)), context)
    assert sorted(result.number for result in found) == list(range(10))
