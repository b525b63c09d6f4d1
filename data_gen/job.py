"""The rendering job: a catalogue's models to a data set, in processes that may die.

A model's samples are made in a process of a `pool.Pool` and left in a file; when all models of a
block are there, the block becomes a shard, and when all blocks are, the data set is complete. What
a model becomes depends on the settings and its name alone, so the data set is the same, byte for
byte, for any number of workers, kills and parts, and on a cluster.
"""

import dataclasses
import hashlib
import json
import os
import pathlib
import time
from collections.abc import Mapping
from typing import Any

from absl import logging

from data_gen import pool, settings, worker
from data_gen.catalogues import Catalogue, Entry
from data_gen.settings import Settings
from psgn_jax.data import records

REPORT = "models.jsonl"

_WORK = ".work"
_FORMAT = 1


class OtherSettingsError(ValueError):
    """The folder holds a data set, complete or begun, that was made with other settings."""


@dataclasses.dataclass(frozen=True)
class Block:
    """Models whose samples make one shard: of one split, in the catalogue's order."""

    split: str
    number: int
    indices: tuple[int, ...]

    @property
    def name(self) -> str:
        """Of the file that says it is done."""
        return f"{self.split}-{self.number:05d}.json"


@dataclasses.dataclass(frozen=True)
class Summary:
    """What came of a job.

    Attributes:
      models: of the catalogue.
      statuses: how many models ended with each status.
      samples: in the data set.
      complete: whether all parts are done.
      lines: the models' lines, in the catalogue's order.
      seconds: that this call took.
      rendered: images that this call rendered.
    """

    models: int
    statuses: Mapping[str, int]
    samples: int
    complete: bool
    lines: tuple[Mapping[str, Any], ...]
    seconds: float
    rendered: int

    @property
    def exit_code(self) -> int:
        """0 all models have samples; 1 some were refused; 2 all were; 3 other parts are open."""
        if not self.complete:
            return 3
        if not self.samples:
            return 2
        return 0 if self.statuses.get("ok", 0) == self.models else 1

    def text(self) -> str:
        """For people."""
        passed = self.statuses.get("ok", 0)
        out = [
            f"{self.models} models: "
            + ", ".join(f"{n} {status}" for status, n in sorted(self.statuses.items())),
            f"{self.samples} samples"
            + ("" if self.complete else "; other parts of the job are not done"),
        ]
        if self.rendered:
            rate = self.rendered / max(self.seconds, 1e-9)
            out.append(f"{self.rendered} images in {self.seconds:.0f} s: {rate:.2f} images/s")
        views = [v for line in self.lines if line["status"] == "ok" for v in line["views"]]
        if views:
            mean = sum(v["inside"] for v in views) / len(views)
            out.append(
                f"points inside the mask grown by a pixel: {100 * mean:.3f} %; depth off the "
                f"points: {max(v['depth'] for v in views):.4f} at worst; brightness "
                f"{min(v['luminance'] for v in views):.1f} to "
                f"{max(v['luminance'] for v in views):.1f}; peak memory of a worker "
                f"{max(line.get('megabytes', 0) for line in self.lines)} MB"
            )
        for line in self.lines:
            if line["status"] != "ok" and len(out) < 40:
                out.append(f"  {line['status']}: {line['model_id']}: {line['reason']}")
        if self.models - passed > len([o for o in out if o.startswith("  ")]):
            out.append(f"  and more: see {REPORT}")
        return "\n".join(out)


def _blocks(entries: list[Entry], size: int) -> list[Block]:
    """All blocks, those of a split in order."""
    result = []
    for split in dict.fromkeys(entry.split for entry in entries):
        own = [i for i, entry in enumerate(entries) if entry.split == split]
        result += [
            Block(split, number, tuple(own[start : start + size]))
            for number, start in enumerate(range(0, len(own), size))
        ]
    # By their first model, so that a job goes through the catalogue.
    return sorted(result, key=lambda block: block.indices[0])


def _job_of(name: str, entries: list[Entry], options: Settings, variant: str) -> dict[str, Any]:
    """All that the bytes of the data set depend on, but for the models' files themselves."""
    models = "\n".join(f"{e.model_id}\t{e.category}\t{e.split}" for e in entries)
    values = settings.to_dict(options)
    del values["job"]
    return {
        "format": _FORMAT,
        "source": name,
        "models": hashlib.sha256(models.encode("utf-8", "surrogatepass")).hexdigest(),
        "settings": json.loads(json.dumps(values)),
        "variant": variant,
    }


def _difference(one: Any, two: Any, name: str = "") -> str:
    """The first field in which two jobs differ."""
    if isinstance(one, dict) and isinstance(two, dict):
        for key in sorted({*one, *two}):
            found = _difference(one.get(key), two.get(key), f"{name}.{key}" if name else key)
            if found:
                return found
        return ""
    return "" if one == two else f"{name}: {one!r} there, {two!r} now"


def _check_folder(out: pathlib.Path, job: Mapping[str, Any], name: str) -> bool:
    """Whether the job's data set is complete in a folder; nothing is written.

    Raises:
      ValueError: the folder holds something else.
    """
    if not out.exists():
        return False
    digest = hashlib.sha256(json.dumps(job, sort_keys=True).encode()).hexdigest()[:16]
    stated = out / _WORK / "job.json"
    if (out / records.MANIFEST).exists():
        manifest = records.load_manifest(out, allow_incomplete=True)
        if manifest.complete:
            tags = {tag for shard in manifest.shards for tag in shard.inputs}
            if manifest.source == name and tags <= {digest}:
                return True
            raise OtherSettingsError(
                f"--out {str(out)!r}: holds a complete data set made with other settings; give "
                "another folder, or remove it"
            )
    elif (
        any(not p.name.startswith(".") for p in out.iterdir())
        and not (
            out / records.MANIFEST  # of another part, since
        ).exists()
    ):
        raise ValueError(f"--out {str(out)!r}: not empty and not a data set")
    if stated.exists():
        difference = _difference(json.loads(stated.read_text()), job)
        if difference.startswith("models:"):
            difference = "other models, or other names or splits of them"
        if difference:
            raise OtherSettingsError(
                f"--out {str(out)!r}: was begun with other settings ({difference}); give another "
                "folder, or remove it"
            )
    return False


def _begin(out: pathlib.Path, job: Mapping[str, Any], name: str) -> bool:
    """Makes or checks the job's folder, as `_check_folder`, and says in it what the job is."""
    if _check_folder(out, job, name):
        return True
    stated = out / _WORK / "job.json"
    if not stated.exists():
        records.write_atomic(stated, json.dumps(job, indent=1) + "\n")
    if not (out / records.MANIFEST).exists():
        records.save_manifest(out, records.Manifest(name, False, ()))
    return False


# --- The data set -----------------------------------------------------------------------------


def _finish_block(out: pathlib.Path, block: Block, digest: str, sources: list[pathlib.Path]) -> int:
    """Writes a block's shard and says so; returns its samples."""
    results = [worker.read_result(path) for path in sources]
    shard = None
    if any(data for _, data in results):
        with records.ShardWriter(out, block.split, block.number, (digest,)) as writer:
            for _, data in results:
                for record in data:
                    writer.write(record, records.decode(record))
        shard = writer.shard
    content = {
        "digest": digest,
        "shard": None if shard is None else dataclasses.asdict(shard),
        "lines": [line for line, _ in results],
        "indices": block.indices,
    }
    records.write_atomic(out / _WORK / block.name, json.dumps(content) + "\n")
    for path in sources:
        path.unlink(missing_ok=True)
    return 0 if shard is None else shard.count


def _read_block(out: pathlib.Path, block: Block, digest: str) -> dict[str, Any] | None:
    """What `_finish_block` has said; None if the block is not done or its shard is not whole."""
    try:
        content: dict[str, Any] = json.loads((out / _WORK / block.name).read_text())
        shard = content["shard"]
        if content["digest"] != digest or tuple(content["indices"]) != block.indices:
            return None
        if shard and (out / shard["file"]).stat().st_size != shard["size"]:
            return None
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return content


def _complete(
    out: pathlib.Path, name: str, blocks: list[Block], digest: str
) -> tuple[list[Mapping[str, Any]], bool]:
    """Completes the data set if all blocks are done; returns the lines there are, in order."""
    contents = [_read_block(out, block, digest) for block in blocks]
    known = [c for c in contents if c is not None]
    numbered = sorted(
        (pair for c in known for pair in zip(c["indices"], c["lines"], strict=True)),
        key=lambda pair: pair[0],
    )
    lines = [line for _, line in numbered]
    if len(known) < len(blocks):
        if records.load_manifest(out, allow_incomplete=True).complete:
            return _read_report(out), True  # another part was last, and has tidied up
        return lines, False
    text = "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines)
    # What no UTF-8 can hold becomes an escape, which JSON understands.
    records.write_atomic(out / REPORT, text.encode("utf-8", "backslashreplace"))
    shards = sorted((c["shard"] for c in known if c["shard"]), key=lambda s: s["file"])
    manifest = records.Manifest(
        name,
        True,
        tuple(
            records.Shard(**{**s, "fields": tuple(s["fields"]), "inputs": tuple(s["inputs"])})
            for s in shards
        ),
    )
    records.save_manifest(out, manifest)
    # Not before the manifest says that all is there; another part may be at the same.
    for path in (out / _WORK).glob("*"):
        path.unlink(missing_ok=True)
    try:
        (out / _WORK).rmdir()
    except OSError:
        logging.info("%s is left to another part of the job", out / _WORK)
    return lines, True


def _read_report(out: pathlib.Path) -> list[Mapping[str, Any]]:
    report = out / REPORT
    text = report.read_text("utf-8") if report.exists() else ""
    return [json.loads(line) for line in text.splitlines()]


def _summary(
    entries: list[Entry],
    lines: list[Mapping[str, Any]],
    complete: bool,
    started: float,
    rendered: int,
) -> Summary:
    statuses: dict[str, int] = {}
    for line in lines:
        statuses[line["status"]] = statuses.get(line["status"], 0) + 1
    if len(lines) < len(entries):
        statuses["open"] = len(entries) - len(lines)
    return Summary(
        models=len(entries),
        statuses=statuses,
        samples=sum(line["samples"] for line in lines),
        complete=complete,
        lines=tuple(lines),
        seconds=time.monotonic() - started,
        rendered=rendered,
    )


def render_catalogue(
    catalogue: Catalogue,
    out: str | os.PathLike[str],
    options: Settings,
    *,
    part: tuple[int, int] = (0, 1),
    limit: int = 0,
    render: pool.Pool = pool.render_local,
) -> Summary:
    """Renders a catalogue to a data set; goes on with one that was begun.

    Args:
      catalogue: where the models come from.
      out: folder of the data set, made where missing.
      options: all settings.
      part: (i, n): the i-th of n parts of the work, i from 0.
      limit: the catalogue's first models alone, 0 = all.
      render: who renders; `cluster.render_on` with an address is another.

    Raises:
      ValueError: `out` holds something else, or a setting is wrong.
      RuntimeError: Mitsuba is missing or does not run, here or where it is to.
    """
    started = time.monotonic()
    out = pathlib.Path(out)
    entries = list(catalogue.entries())[: limit or None]
    if not entries:
        raise ValueError(f"catalogue {catalogue.name!r}: it has no models")
    variant, message = worker.choose_variant(options.job.variant)
    if message:
        logging.warning("%s", message)
    job = _job_of(catalogue.name, entries, options, variant.name)
    digest = hashlib.sha256(json.dumps(job, sort_keys=True).encode()).hexdigest()[:16]
    complete = _check_folder(out, job, catalogue.name)
    if not complete:
        # Before anything is written: what is wrong with these must not mark the folder.
        pictures = (
            worker.list_pictures(options.image.background_folder)
            if options.image.background == "folder"
            else []
        )
        maps = worker.load_maps(options.light, variant, detail=options.image.shading == "photo")
        complete = _begin(out, job, catalogue.name)
    if complete:
        logging.info("%s is complete", out)
        return _summary(entries, _read_report(out), True, started, 0)
    context = worker.Context(options, catalogue.name, variant, maps, pictures)
    folder = out / _WORK
    blocks = _blocks(entries, options.models_per_shard)
    own = blocks[part[0] :: part[1]]
    open_blocks = {b: set(b.indices) for b in own if _read_block(out, b, digest) is None}
    block_of = {i: b for b in open_blocks for i in b.indices}
    for left in folder.glob("*.tmp"):
        if part == (0, 1):
            left.unlink(missing_ok=True)  # of a run that was killed

    def arrived(index: int) -> None:
        block = block_of[index]
        open_blocks[block].discard(index)
        if not open_blocks[block]:
            paths = [worker.work_path(folder, i) for i in block.indices]
            _finish_block(out, block, digest, paths)

    todo = []
    for block in open_blocks:
        for index in block.indices:
            try:
                worker.read_result(worker.work_path(folder, index))
            except ValueError:
                todo.append(index)
    fresh = set(todo)
    for index in [i for i in block_of if i not in fresh]:
        arrived(index)
    logging.info(
        "%d models to do of %d, %d views each, %s", len(todo), len(entries), options.views,
        variant.name,
    )  # fmt: skip
    rendered = refused = 0
    told = time.monotonic()
    results = render([(i, entries[i]) for i in todo], context) if todo else ()
    for done, (index, line, content) in enumerate(results, 1):
        worker.write_result(folder, index, content)
        arrived(index)
        rendered += line["samples"]
        if line["status"] != "ok":
            refused += 1
            logging.warning("%s: %s: %s", line["status"], line["model_id"], line["reason"])
        now = time.monotonic()
        if now - told > 10 or done == len(todo):
            told = now
            seconds = (now - started) / done * (len(todo) - done)
            logging.info(
                "%d of %d models, %d images, %.2f images/s, %d refused, %d:%02d:%02d left",
                done, len(todo), rendered, rendered / (now - started), refused,
                seconds // 3600, seconds % 3600 // 60, seconds % 60,
            )  # fmt: skip
    lines, complete = _complete(out, catalogue.name, blocks, digest)
    return _summary(entries, lines, complete, started, rendered)
