"""The rendering job: renders the models of a catalogue to a data set, in several processes.

For a given model file, the samples depend only on the settings and the model's name. The data set
is therefore identical, byte for byte, for any number of workers, restarts and parts. It is also the
same if it is rendered on a cluster, or extended instead of rendered at once.

The folder of a job:

    <split>-<number>-<digest>.arrayrecord   shard: samples of a block of models
    manifest.json                           the shards that readers see
    models.jsonl                            a line for each model, in the catalogue's order
    job.json                                settings, and how the models were chosen
    .work/job.json                          the same of the job under way, with its models
    .work/<hash>.model                      line and samples of a model

When all models are rendered, the shards are written. The digest of a shard is computed from the
settings and the names of its models. When a data set is extended, new shards are written next to
the existing ones, and the manifest is then replaced, which switches readers to the new state
atomically. Unchanged shards are kept; the samples of other existing shards are copied, not rendered
again.
"""

import contextlib
import dataclasses
import hashlib
import json
import os
import pathlib
import re
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import msgpack
from absl import logging

from data_gen import pool
from data_gen.catalogues import choosing
from data_gen.catalogues.choosing import Choice
from data_gen.catalogues.entry import (
    SPLITS,
    Catalogue,
    Entry,
    moved_to_empty_splits,
    original_name,
)
from data_gen.engine import choose_variant
from data_gen.environment_maps import load_maps
from data_gen.render_model import Context
from data_gen.settings import Settings
from psgn_jax.config import structured
from psgn_jax.data.codec import decode, unpack
from psgn_jax.data.dataset import ShardWriter, read_shard, shard_name
from psgn_jax.data.manifest import MANIFEST, Manifest, Shard, load_manifest, save_manifest
from psgn_jax.system.claims import claim
from psgn_jax.system.files import remove_temporaries, write_atomic
from psgn_jax.system.untrusted import one_line, parse_json, read_json

REPORT = "models.jsonl"
JOB = "job.json"
WORK = ".work"

# Increased when the same settings give other samples or the layout of the folder changes.
_FORMAT = 2

_SHARD = re.compile(r"[a-z0-9_]+-[0-9]{5}-[0-9a-f]{8}\.arrayrecord")

Line = Mapping[str, Any]
"""A line of `models.jsonl`."""


class OtherSettingsError(ValueError):
    """The folder holds a data set, complete or not, that was rendered with other settings."""


# --- The specification of a job ---------------------------------------------------------------


FEW_MODELS = 20
"""A warning is logged for smaller sets."""


class Name(NamedTuple):
    """Name, category and split of a model."""

    model_id: str
    category: str
    split: str


class Block(NamedTuple):
    """The models of a shard: from one split, in the order of the catalogue.

    Attributes:
      split: their split.
      number: number of the block in its split.
      indices: numbers of the models in the job.
      digest: digest of the settings and the names.
    """

    split: str
    number: int
    indices: tuple[int, ...]
    digest: str

    @property
    def shard(self) -> str:
        """The name of the file of records."""
        return shard_name(self.split, self.number, self.digest[:8])


@dataclasses.dataclass(frozen=True)
class Job:
    """The specification of a data set, without the files of the models.

    Attributes:
      statement: settings, catalogue and renderer: everything that determines the samples of a
        model, besides its name and category.
      choice: how the models were chosen, as text for messages.
      names: the models, in the order of the catalogue.
      moved: new splits of objects that left the split of their catalogue, see `_with_all_splits`.
    """

    statement: Mapping[str, Any]
    choice: Mapping[str, Any]
    names: tuple[Name, ...]
    moved: Mapping[str, str]

    def stated(self) -> dict[str, Any]:
        """The content of `job.json`."""
        stated = {"job": self.statement, "choice": self.choice}
        return stated | ({"moved": self.moved} if self.moved else {})

    def blocks(self) -> list[Block]:
        """All blocks, sorted by their first model."""
        size = self.statement["settings"]["models_per_shard"]
        result = []
        for split in dict.fromkeys(name.split for name in self.names):
            own = [i for i, name in enumerate(self.names) if name.split == split]
            for number, start in enumerate(range(0, len(own), size)):
                indices = tuple(own[start : start + size])
                text = json.dumps(
                    [self.statement, [self.names[i] for i in indices]], sort_keys=True
                )
                digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:16]
                result.append(Block(split, number, indices, digest))
        return sorted(result, key=lambda block: block.indices[0])


def _job_of(
    name: str, entries: Sequence[Entry], options: Settings, variant: str, choice: Choice,
    limit: int, moved: Mapping[str, str],
) -> Job:  # fmt: skip
    """Everything that determines the bytes of the data set, except the contents of model files."""
    values = structured.to_dict(options)
    del values["job"]
    values["image"]["background_folder"] = ""  # a former setting; part of the names of shards
    statement = {"format": _FORMAT, "source": name, "settings": values, "variant": variant}
    return Job(
        statement=json.loads(json.dumps(statement)),
        choice=json.loads(json.dumps({**dataclasses.asdict(choice), "limit": limit})),
        names=tuple(Name(e.model_id, e.category, e.split) for e in entries),
        moved=moved,
    )


def _with_all_splits(
    out: pathlib.Path, entries: Sequence[Entry], fractions: Sequence[float]
) -> tuple[list[Entry], dict[str, str]]:
    """The models with splits such that none is empty, and the objects that this moves.

    Models in the folder keep their splits. See `catalogues.entry.moved_to_empty_splits`.
    """
    stated = [s for s in map(_specification, (out / JOB, out / WORK / JOB)) if s is not None]
    lines = read_report(out) if (out / REPORT).exists() else []
    there = {
        original_name(n.model_id) for n in [*_names(lines), *(n for s in stated for n in s[1])]
    }
    moved = {name: split for s in stated for name, split in s[0].get("moved", {}).items()}
    moved = {name: split for name, split in moved.items() if split in SPLITS}
    splits = {original_name(e.model_id): e.split for e in entries}
    splits |= {name: split for name, split in moved.items() if name in splits}
    wanted = [split for split, fraction in zip(SPLITS, fractions, strict=True) if fraction]
    moved |= moved_to_empty_splits(splits, wanted, there)
    splits |= moved
    if len(splits) < FEW_MODELS:
        counts = Counter(splits.values())
        logging.warning(
            "a small set: %s; a network overfits on it, and its figures say little; "
            "--option=fractions=0.6,0.2,0.2 sets the fractions of the splits",
            ", ".join(f"{counts[split]} models in {split!r}" for split in wanted),
        )
    return [
        dataclasses.replace(e, split=splits[original_name(e.model_id)]) for e in entries
    ], moved  # fmt: skip


# --- The job ----------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Summary:
    """The result of a job.

    Attributes:
      models: number of models of the catalogue.
      lines: lines of the models, in the order of the catalogue; if the job is not complete, those
        of this part.
      complete: whether all parts are done.
      seconds: duration of this call.
      rendered: number of images that this call rendered.
    """

    models: int
    lines: tuple[Line, ...]
    complete: bool
    seconds: float
    rendered: int

    @property
    def samples(self) -> int:
        """Number of samples of the lines."""
        return sum(line["samples"] for line in self.lines)

    @property
    def statuses(self) -> dict[str, int]:
        """Number of models with each status; "open" are those of other parts."""
        counts = Counter(line["status"] for line in self.lines)
        left = self.models - len(self.lines)
        return dict(counts) | ({"open": left} if left else {})

    @property
    def exit_code(self) -> int:
        """Exit code of the command.

        0 all models have samples; 1 some were refused; 2 all were refused; 3 other parts are not
        finished.
        """
        if not self.complete:
            return 3
        if not self.samples:
            return 2
        return 0 if self.statuses.get("ok", 0) == self.models else 1

    def text(self) -> str:
        """The summary as text, with at most 40 reasons of refusals."""
        counts = ", ".join(f"{n} {status}" for status, n in sorted(self.statuses.items()))
        later = "" if self.complete else "; other parts of the job are not finished"
        out = [f"{self.models} models: {counts}", f"{self.samples} samples{later}"]
        if self.rendered:
            rate = self.rendered / max(self.seconds, 1e-9)
            out.append(f"{self.rendered} images in {self.seconds:.0f} s: {rate:.2f} images/s")
        views = [v for line in self.lines if line["status"] == "ok" for v in line["views"]]
        if views:
            mean = sum(v["inside"] for v in views) / len(views)
            out.append(
                f"points inside the dilated mask: {100 * mean:.3f} %; median distance of depth "
                f"from points: at most {max(v['depth'] for v in views):.4f}; brightness: "
                f"{min(v['luminance'] for v in views):.1f} to "
                f"{max(v['luminance'] for v in views):.1f}; peak memory of a worker: "
                f"{max(line.get('megabytes', 0) for line in self.lines)} MB"
            )
        refused = [line for line in self.lines if line["status"] != "ok"]
        out += [f"  {x['status']}: {x['model_id']}: {x['reason']}" for x in refused[:40]]
        if len(refused) > 40:
            out.append(f"  and more: see {REPORT}")
        return "\n".join(map(one_line, out))


def render_catalogue(
    catalogue: Catalogue,
    out: str | os.PathLike[str],
    options: Settings,
    *,
    part: tuple[int, int] = (0, 1),
    choice: Choice | None = None,
    limit: int = 0,
    render: pool.Pool = pool.render_local,
) -> Summary:
    """Renders a catalogue to a data set; continues an incomplete one or extends a complete one.

    If the folder contains a complete data set and all its models are among those of this call, the
    other models of this call are added. Readers see the old state until the new one is complete.
    If a catalogue divides its models by `split_of` and a split would be empty, a model is moved.

    Args:
      catalogue: source of the models.
      out: folder of the data set, created if missing.
      options: all settings.
      part: (i, n): the i-th of n parts of the work, i from 0.
      choice: which models of the catalogue are used; None = all.
      limit: use only the first `limit` of the chosen models; 0 = all.
      render: function that renders the models: `pool.render_local`, or `cluster.render_on` with an
        address.

    Raises:
      ValueError: `out` contains something else, or models that are not in this call; another
        process renders the same part; or a setting is wrong.
      RuntimeError: Mitsuba is missing or does not run, on this machine or on the workers.
    """
    started = time.monotonic()
    out = pathlib.Path(out)
    choice = choice or Choice()
    entries = choosing.choose(catalogue.models, choice)[: limit or None]
    if not entries:
        raise ValueError(f"catalogue {catalogue.name!r}: it has no models")
    variant, message = choose_variant(options.job.variant)
    if message:
        logging.warning("%s", message)
    moved: dict[str, str] = {}
    if catalogue.fractions is not None:
        entries, moved = _with_all_splits(out, entries, catalogue.fractions)
    job = _job_of(catalogue.name, entries, options, variant.name, choice, limit, moved)
    lines: list[Line] = []
    rendered, complete = 0, _check(out, job)
    if not complete:
        # Read before anything is written, so that an error here leaves the folder unchanged.
        maps = load_maps(options.light, variant, detail=options.image.shading == "photo")
        context = Context(options, catalogue.name, variant, maps)
        with claim(out / WORK, part):
            complete = _check(out, job)  # another process may have completed it meanwhile
            if not complete:
                _begin(out, job)
                lines, rendered = _render_part(out, job, entries, context, part, render, started)
                complete = _complete(out, job)
    if complete:
        _tidy_up(out, job)
        lines = read_report(out)
    seconds = time.monotonic() - started
    return Summary(len(entries), tuple(lines), complete, seconds, rendered)


def _render_part(
    out: pathlib.Path,
    job: Job,
    entries: Sequence[Entry],
    context: Context,
    part: tuple[int, int],
    render: pool.Pool,
    started: float,
) -> tuple[list[Line], int]:
    """Renders the missing models of a part; returns its lines and the number of new images."""
    if part == (0, 1):
        remove_temporaries(out / WORK)  # left by a process that was killed
    blocks = job.blocks()[part[0] :: part[1]]
    old, kept = _take_over(out, job, blocks)
    lines: dict[int, Line] = {}
    todo = []
    for block in blocks:
        for i in block.indices:
            name = entries[i].model_id
            result = (old[name], ()) if block.shard in kept else _read_result(out, name)
            if result is None:
                todo.append(i)
            else:
                lines[i] = result[0]
    logging.info(
        "%d of %d models to render, %d views each, %s", len(todo), len(entries),
        context.settings.views, context.variant.name,
    )  # fmt: skip
    rendered = refused = 0
    reported = time.monotonic()
    with contextlib.closing(render([(i, entries[i]) for i in todo], context)) as results:
        for done, (index, line, records) in enumerate(results if todo else (), 1):
            _write_result(out, line, records)
            lines[index] = line
            rendered += line["samples"]
            if line["status"] != "ok":
                refused += 1
                what = one_line(f"{line['status']}: {line['model_id']}: {line['reason']}")
                logging.warning("%s", what)
            now = time.monotonic()
            if now - reported > 10 or done == len(todo):
                reported = now
                seconds = (now - started) / done * (len(todo) - done)
                logging.info(
                    "%d of %d models, %d images, %.2f images/s, %d refused, %d:%02d:%02d left",
                    done, len(todo), rendered, rendered / (now - started), refused,
                    seconds // 3600, seconds % 3600 // 60, seconds % 60,
                )  # fmt: skip
    return [lines[i] for i in sorted(lines)], rendered


# --- The state of the folder ------------------------------------------------------------------


def _check(out: pathlib.Path, job: Job) -> bool:
    """Whether the data set of a job is complete in a folder; nothing is written.

    Raises:
      OtherSettingsError: the folder holds a data set that the job cannot continue or extend.
      ValueError: the folder holds something else.
    """
    if not out.exists():
        return False
    if not (out / MANIFEST).exists():
        if not all(path.name.startswith(".") for path in out.iterdir()):
            raise ValueError(
                f"--out {str(out)!r}: not a data set, expected an empty or new folder or a data set"
            )
    elif load_manifest(out, allow_incomplete=True).complete:
        stated = _specification(out / JOB)
        if stated is None or not (out / REPORT).exists():
            raise OtherSettingsError(
                f"--out {str(out)!r}: holds a complete data set without {REPORT if stated else JOB}"
                ", made by another command or an earlier version; give another folder, or remove it"
            )
        lines = read_report(out)
        there = _names(lines)
        _check_same(out, stated[0], there, job, "holds a complete data set made with")
        if there == list(job.names):
            full = {line["model_id"] for line in lines if line["samples"]}
            blocks = (
                b for b in job.blocks() if any(job.names[i].model_id in full for i in b.indices)
            )
            if {block.shard for block in blocks} == {s.file for s in load_manifest(out).shards}:
                return True
    unfinished = _specification(out / WORK / JOB)
    if unfinished is not None:
        _check_same(out, *unfinished, job, "was started with")
    return False


def _specification(path: pathlib.Path) -> tuple[dict[str, Any], list[Name]] | None:
    """The content of a `job.json`, and the models in it; None if it is missing or damaged."""
    try:
        stated = read_json(path)
        names = [Name(*map(str, name)) for name in stated.get("models", [])]
        sections = (stated["job"], stated.get("choice", {}), stated.get("moved", {}))
        return (stated, names) if all(isinstance(s, dict) for s in sections) else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _check_same(
    out: pathlib.Path, stated: Mapping[str, Any], there: Sequence[Name], job: Job, what: str
) -> None:
    """Raises `OtherSettingsError` if a job cannot continue or extend the data set of a folder."""
    difference = _difference(stated["job"], job.statement).removeprefix("settings.")
    if difference:
        raise OtherSettingsError(
            f"--out {str(out)!r}: {what} other settings ({difference}); give another folder, or "
            "remove it"
        )
    lost = sorted(set(there) - set(job.names), key=there.index)
    if lost:
        choice = _difference(stated.get("choice", {}), dict(job.choice))
        shown = "; ".join(f"{n.model_id!r}, {n.category!r}, {n.split}" for n in lost[:3])
        raise OtherSettingsError(
            f"--out {str(out)!r}: {what} other models: {len(lost)} of its {len(there)} models are "
            f"not among the {len(job.names)} of this command, with the same category and split "
            f"({shown}{'; ...' * (len(lost) > 3)}){choice and f'; --{choice}'}; a data set can get "
            "more models, but cannot lose any: give another folder, or remove it"
        )


def _difference(one: Any, two: Any, name: str = "") -> str:
    """The first field in which two specifications differ; "" if they are equal."""
    if isinstance(one, dict) and isinstance(two, dict):
        keys = sorted({*one, *two})
        texts = (_difference(one.get(k), two.get(k), f"{name}.{k}".lstrip(".")) for k in keys)
        return next(filter(None, texts), "")
    return "" if one == two else f"{name}: {one!r} before, {two!r} now"


def _begin(out: pathlib.Path, job: Job) -> None:
    """Writes the specification of a job, and an empty manifest if there is none."""
    stated = job.stated() | {"models": job.names}
    write_atomic(out / WORK / JOB, json.dumps(stated) + "\n")
    if not (out / MANIFEST).exists():
        save_manifest(out, Manifest(job.statement["source"], False, ()))


def _complete(out: pathlib.Path, job: Job) -> bool:
    """Completes the data set if all models are rendered; returns whether it is complete.

    Raises:
      RuntimeError: another command has started a different job in the folder.
      ValueError: a result was damaged meanwhile.
    """
    blocks = job.blocks()
    old, kept = _finished(out)
    fresh = [block for block in blocks if block.shard not in kept]
    names = [job.names[i].model_id for block in fresh for i in block.indices]
    if not all(_result_path(out, name).exists() for name in names):
        return _check(out, job)  # another part may have completed it
    unfinished = _specification(out / WORK / JOB)
    if unfinished is None or unfinished[1] != list(job.names):
        raise RuntimeError(
            f"--out {str(out)!r}: another command has started to render other models to it; the "
            "samples rendered so far are kept for that command"
        )
    lines: dict[int, Line] = {}
    shards = []
    for block in blocks:
        if block in fresh:
            block_lines, shard = _write_shard(out, job, block)
        else:
            block_lines, shard = (
                [old[job.names[i].model_id] for i in block.indices],
                kept[block.shard],
            )
        lines |= zip(block.indices, block_lines, strict=True)
        shards += [shard] if shard else []
    text = "".join(json.dumps(lines[i], ensure_ascii=False) + "\n" for i in sorted(lines))
    # Characters that UTF-8 cannot encode are written as escapes of JSON.
    write_atomic(out / REPORT, text.encode("utf-8", "backslashreplace"))
    write_atomic(out / JOB, json.dumps(job.stated(), indent=1) + "\n")
    shards.sort(key=lambda shard: shard.file)
    # Switches readers to the new state.
    save_manifest(out, Manifest(job.statement["source"], True, tuple(shards)))
    return True


def _write_shard(out: pathlib.Path, job: Job, block: Block) -> tuple[list[Line], Shard | None]:
    """Writes the shard of a block from the results of its models, if they have samples."""
    results = [_read_result(out, job.names[i].model_id) for i in block.indices]
    whole = [result for result in results if result is not None]
    if len(whole) < len(results):
        raise ValueError(f"{out / WORK}: samples were damaged meanwhile; run the command again")
    lines = [line for line, _ in whole]
    if not any(records for _, records in whole):
        return lines, None
    with ShardWriter(
        out, block.split, block.number, (block.digest,), tag=block.digest[:8]
    ) as writer:
        for _, records in whole:
            for record in records:
                writer.write(record, decode(record))
    return lines, writer.shard


def _tidy_up(out: pathlib.Path, job: Job) -> None:
    """Removes files that are not part of the complete data set.

    Another process may do the same at the same time.
    """
    unfinished = _specification(out / WORK / JOB)
    if unfinished is not None and unfinished[1] != list(job.names):
        return  # the data set is being extended
    if unfinished is not None:
        kept = {shard.file for shard in load_manifest(out).shards}
        remove_temporaries(out)
        for path in out.iterdir():
            if _SHARD.fullmatch(path.name) and path.name not in kept:
                path.unlink(missing_ok=True)
        for path in (out / WORK).glob("*"):
            if path.name != JOB:
                path.unlink(missing_ok=True)
        (out / WORK / JOB).unlink(missing_ok=True)  # last, so that cleaning resumes after a kill
    with contextlib.suppress(OSError):  # another part may still use it
        (out / WORK).rmdir()


# --- Results and lines ------------------------------------------------------------------------


def _result_path(out: pathlib.Path, model_id: str) -> pathlib.Path:
    name = hashlib.sha256(model_id.encode("utf-8", "surrogatepass")).hexdigest()[:24]
    return out / WORK / f"{name}.model"


def _write_result(out: pathlib.Path, line: Line, records: Sequence[bytes]) -> None:
    packed = msgpack.packb({"line": json.dumps(line), "records": list(records)})
    write_atomic(_result_path(out, line["model_id"]), packed, sync=False)


def _read_result(out: pathlib.Path, model_id: str) -> tuple[Line, Sequence[bytes]] | None:
    """The line and the records of a rendered model; None if they are missing or damaged."""
    try:
        content = msgpack.unpackb(_result_path(out, model_id).read_bytes())
        return parse_json(content["line"]), list(content["records"])
    except Exception:  # msgpack raises many types of errors
        return None


def read_report(out: pathlib.Path) -> list[Line]:
    """The lines of the models of a complete data set.

    Raises:
      ValueError: the file is damaged.
    """
    try:
        lines = [parse_json(line) for line in (out / REPORT).read_bytes().split(b"\n") if line]
        if not all(map(_is_line, lines)):
            raise ValueError("a line does not describe a model")
    except (OSError, ValueError) as error:
        raise ValueError(
            f"{out / REPORT}: damaged ({one_line(error)}); render the data set again"
        ) from None
    return lines


def _is_line(line: Any) -> bool:
    """Whether a model's line has the fields that this module reads."""
    return (
        isinstance(line, dict)
        and all(isinstance(line.get(k), str) for k in ("model_id", "category", "split", "status"))
        and isinstance(line.get("samples"), int)
        and line["samples"] >= 0
    )


def _names(lines: Iterable[Line]) -> list[Name]:
    return [Name(line["model_id"], line["category"], line["split"]) for line in lines]


# --- Growth -----------------------------------------------------------------------------------


def _finished(out: pathlib.Path) -> tuple[dict[str, Line], dict[str, Shard]]:
    """The lines of a complete data set by model, and its shards by name; empty without one."""
    manifest = load_manifest(out, allow_incomplete=True)
    if not manifest.complete:
        return {}, {}
    shards = {shard.file: shard for shard in manifest.shards if _is_whole(out, shard)}
    return {line["model_id"]: line for line in read_report(out)}, shards


def _is_whole(out: pathlib.Path, shard: Shard) -> bool:
    path = out / shard.file
    return path.exists() and path.stat().st_size == shard.size


def _take_over(
    out: pathlib.Path, job: Job, blocks: Iterable[Block]
) -> tuple[dict[str, Line], dict[str, Shard]]:
    """Reuses the samples of a complete, smaller version of a job in the folder.

    Shards of unchanged blocks are kept. The samples of models whose blocks have changed are written
    to the files of these models, as if they had just been rendered.

    Args:
      out: the folder.
      job: the job whose data set is written.
      blocks: its blocks that are to be completed.

    Returns:
      See `_finished`.
    """
    old, kept = _finished(out)
    changed = (job.names[i].model_id for b in blocks if b.shard not in kept for i in b.indices)
    wanted = {name for name in changed if name in old and not _result_path(out, name).exists()}
    earlier = dataclasses.replace(job, names=tuple(_names(old.values())))
    for block in earlier.blocks() if wanted else ():
        lines = [old[earlier.names[i].model_id] for i in block.indices]
        if not wanted.isdisjoint(line["model_id"] for line in lines):
            for line, records in _samples(out / block.shard, lines):
                if line["model_id"] in wanted:
                    _write_result(out, line, records)
    return old, kept


def _samples(path: pathlib.Path, lines: Sequence[Line]) -> Iterator[tuple[Line, list[bytes]]]:
    """The records of a shard by model; nothing if the shard does not fit the lines."""
    records: list[bytes] = []
    if any(line["samples"] for line in lines):
        try:
            records = read_shard(path)
            owners = [unpack(record)["model_id"] for record in records]
        except (ValueError, KeyError):  # missing or damaged: rendered again
            return
        if owners != [line["model_id"] for line in lines for _ in range(line["samples"])]:
            return
    start = 0
    for line in lines:
        yield line, records[start : start + line["samples"]]
        start += line["samples"]
