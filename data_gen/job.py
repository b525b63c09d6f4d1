"""The rendering job: renders the models of a catalogue to a data set, in several processes.

For a given model file, the samples depend only on the settings and the model's name. The data set
is therefore identical, byte for byte, for any number of workers, restarts and parts. It is also the
same if it is rendered on a cluster, or extended instead of rendered at once.

The folder of a job:

    <split>-<number>-<digest>.arrayrecord   samples of a block of models
    manifest.json                           the shards that readers see
    models.jsonl                            a line for each model, in the catalogue's order
    job.json                                settings, and how the models were chosen
    .work/job.json                          the same of the job under way, with its models
    .work/<hash>.model                      line and samples of a model
    .work/<split>-<number>-<digest>.json    lines and shard of a complete block

When all models of a block are rendered, the block becomes a shard. The digest of a block is
computed from the settings and the names of its models, and is part of the name of the shard. When a
data set is extended, new shards are written next to the existing ones, and the manifest is then
replaced, which switches readers to the new state atomically. Shards of unchanged blocks are kept.
The samples of other existing shards are copied, not rendered again.
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
from data_gen.scene import list_pictures
from data_gen.settings import Settings
from psgn_jax.config import structured
from psgn_jax.data.codec import decode, unpack
from psgn_jax.data.dataset import ShardWriter, read_shard, shard_name
from psgn_jax.data.manifest import MANIFEST, Manifest, load_manifest, save_manifest, shard_of
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


@dataclasses.dataclass(frozen=True)
class Block:
    """The models of a shard: from one split, in the order of the catalogue.

    Attributes:
      split: their split.
      number: number of the block in its split.
      indices: numbers of the models in the job.
      names: the models.
      digest: digest of the settings and the names.
    """

    split: str
    number: int
    indices: tuple[int, ...]
    names: tuple[Name, ...]
    digest: str

    @property
    def shard(self) -> str:
        """The name of the file of records."""
        return shard_name(self.split, self.number, self.digest[:8])

    @property
    def note(self) -> str:
        """The name of the file that marks the block as complete."""
        return f"{self.split}-{self.number:05d}-{self.digest}.json"


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
                names = tuple(self.names[i] for i in indices)
                text = json.dumps([self.statement, names], sort_keys=True)
                digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:16]
                result.append(Block(split, number, indices, names, digest))
        return sorted(result, key=lambda block: block.indices[0])


def job_of(
    name: str, entries: Sequence[Entry], options: Settings, variant: str, choice: Choice,
    limit: int, moved: Mapping[str, str],
) -> Job:  # fmt: skip
    """Everything that determines the bytes of the data set, except the contents of model files."""
    values = structured.to_dict(options)
    del values["job"]
    return Job(
        statement={
            "format": _FORMAT,
            "source": name,
            "settings": json.loads(json.dumps(values)),
            "variant": variant,
        },
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
      lines: lines of the models rendered so far, in the order of the catalogue.
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
        """Number of samples in the data set."""
        return sum(line["samples"] for line in self.lines)

    @property
    def statuses(self) -> dict[str, int]:
        """Number of models with each status; "open" if another part has not rendered them yet."""
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
    entries = choosing.choose(list(catalogue.entries()), choice)[: limit or None]
    if not entries:
        raise ValueError(f"catalogue {catalogue.name!r}: it has no models")
    variant, message = choose_variant(options.job.variant)
    if message:
        logging.warning("%s", message)
    moved: dict[str, str] = {}
    if catalogue.fractions is not None:
        entries, moved = _with_all_splits(out, entries, catalogue.fractions)
    job = job_of(catalogue.name, entries, options, variant.name, choice, limit, moved)
    lines: list[Line] = []
    rendered, complete = 0, _check(out, job)
    if not complete:
        # Read before anything is written, so that an error here leaves the folder unchanged.
        folder = options.image.background == "folder"
        pictures = list_pictures(options.image.background_folder) if folder else []
        maps = load_maps(options.light, variant, detail=options.image.shading == "photo")
        context = Context(options, catalogue.name, variant, maps, pictures)
        with claim(out / WORK, part):
            complete = _check(out, job)  # another process may have completed it meanwhile
            if not complete:
                _begin(out, job)
                rendered = _render_part(out, job, entries, context, part, render, started)
                lines, complete = _complete(out, job)
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
) -> int:
    """Renders the missing models of a part of the work; returns the number of images."""
    if part == (0, 1):
        remove_temporaries(out / WORK)  # left by a process that was killed
    blocks = job.blocks()[part[0] :: part[1]]
    _take_over(out, blocks, job)
    open_blocks = [block for block in blocks if _read_block(out, block) is None]
    left: dict[int, tuple[Block, set[int]]] = {}  # by model: its block, and what this one lacks
    for block in open_blocks:
        lacking = {i for i in block.indices if _read_result(out, entries[i].model_id) is None}
        left |= dict.fromkeys(lacking, (block, lacking))
        if not lacking:
            _finish_block(out, block)
    todo = [i for block in open_blocks for i in block.indices if i in left]
    logging.info(
        "%d of %d models to render, %d views each, %s", len(todo), len(entries),
        context.settings.views, context.variant.name,
    )  # fmt: skip
    rendered = refused = 0
    reported = time.monotonic()
    with contextlib.closing(render([(i, entries[i]) for i in todo], context)) as results:
        for done, (index, line, records) in enumerate(results if todo else (), 1):
            _write_result(out, line, records)
            block, lacking = left[index]
            lacking.discard(index)
            if not lacking:
                _finish_block(out, block)
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
    return rendered


# --- The state of the folder ------------------------------------------------------------------


def _check(out: pathlib.Path, job: Job) -> bool:
    """Whether the data set of a job is complete in a folder; nothing is written.

    Raises:
      OtherSettingsError: the folder holds a data set that the job cannot continue or extend.
      ValueError: the folder holds something else.
    """
    if not out.exists():
        return False
    hidden_only = all(path.name.startswith(".") for path in out.iterdir())
    if not (out / MANIFEST).exists():
        if not hidden_only:
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
        if there == list(job.names) and _shards_of(job, lines) == {
            shard.file for shard in load_manifest(out).shards
        }:
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
        for key in sorted({*one, *two}):
            text = _difference(one.get(key), two.get(key), f"{name}.{key}" if name else key)
            if text:
                return text
        return ""
    return "" if one == two else f"{name}: {one!r} before, {two!r} now"


def _begin(out: pathlib.Path, job: Job) -> None:
    """Writes the specification of a job, and an empty manifest if there is none."""
    stated = job.stated() | {"models": job.names}
    write_atomic(out / WORK / JOB, json.dumps(stated) + "\n")
    if not (out / MANIFEST).exists():
        save_manifest(out, Manifest(job.statement["source"], False, ()))


def _complete(out: pathlib.Path, job: Job) -> tuple[list[Line], bool]:
    """Completes the data set if all blocks are done.

    Returns:
      The lines of the models rendered so far, in order, and whether the data set is complete.

    Raises:
      RuntimeError: another command has started a different job in the folder.
    """
    blocks = [(block, _read_block(out, block)) for block in job.blocks()]
    numbered = {
        index: line
        for block, content in blocks
        if content is not None
        for index, line in zip(block.indices, content["lines"], strict=True)
    }
    lines = [numbered[index] for index in sorted(numbered)]
    unfinished = _specification(out / WORK / JOB)
    if unfinished is None and _check(out, job):
        return lines, True  # another part has completed the data set
    if len(lines) < len(job.names):
        return lines, False
    if unfinished is None or unfinished[1] != list(job.names):
        raise RuntimeError(
            f"--out {str(out)!r}: another command has started to render other models to it; the "
            "samples rendered so far are kept for that command"
        )
    text = "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines)
    # Characters that UTF-8 cannot encode are written as escapes of JSON.
    write_atomic(out / REPORT, text.encode("utf-8", "backslashreplace"))
    write_atomic(out / JOB, json.dumps(job.stated(), indent=1) + "\n")
    shards = [content["shard"] for _, content in blocks if content and content["shard"]]
    shards.sort(key=lambda shard: str(shard["file"]))
    # Switches readers to the new state.
    save_manifest(out, Manifest(job.statement["source"], True, tuple(map(shard_of, shards))))
    return lines, True


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


# --- Results, blocks, lines -------------------------------------------------------------------


def _result_path(out: pathlib.Path, model_id: str) -> pathlib.Path:
    name = hashlib.sha256(model_id.encode("utf-8", "surrogatepass")).hexdigest()[:24]
    return out / WORK / f"{name}.model"


def _write_result(out: pathlib.Path, line: Line, records: Sequence[bytes]) -> None:
    packed = msgpack.packb({"line": json.dumps(line), "records": list(records)})
    write_atomic(_result_path(out, line["model_id"]), packed, sync=False)


def _read_result(out: pathlib.Path, model_id: str) -> tuple[dict[str, Any], list[bytes]] | None:
    """The line and the records of a rendered model; None if they are missing or damaged."""
    try:
        content = msgpack.unpackb(_result_path(out, model_id).read_bytes())
        return parse_json(content["line"]), list(content["records"])
    except Exception:  # msgpack raises many types of errors
        return None


def _finish_block(out: pathlib.Path, block: Block) -> None:
    """Writes the shard of a block from the files of its models and marks the block as complete."""
    results = [_read_result(out, name.model_id) for name in block.names]
    whole = [result for result in results if result is not None]
    if len(whole) < len(results):
        raise ValueError(f"{out / WORK}: samples were damaged meanwhile; run the command again")
    shard = None
    if any(records for _, records in whole):
        with ShardWriter(
            out, block.split, block.number, (block.digest,), tag=block.digest[:8]
        ) as writer:
            for _, records in whole:
                for record in records:
                    writer.write(record, decode(record))
        shard = dataclasses.asdict(writer.shard)
    _write_note(out, block, shard, [line for line, _ in whole])
    for name in block.names:
        _result_path(out, name.model_id).unlink(missing_ok=True)


def _write_note(out: pathlib.Path, block: Block, shard: Any, lines: Sequence[Line]) -> None:
    write_atomic(out / WORK / block.note, json.dumps({"shard": shard, "lines": lines}) + "\n")


def _read_block(out: pathlib.Path, block: Block) -> dict[str, Any] | None:
    """The note of a complete block; None if the block is not complete or its shard is damaged."""
    try:
        content: dict[str, Any] = read_json(out / WORK / block.note)
        shard = content["shard"]
        if not all(map(_is_line, content["lines"])):
            return None
        if _names(content["lines"]) != list(block.names):
            return None
        if shard and (out / shard_of(shard).file).stat().st_size != shard["size"]:
            return None
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return content


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


def _shards_of(job: Job, lines: Sequence[Line]) -> set[str]:
    """Names of the shards of a complete job, whose models have these lines."""
    samples = {line["model_id"]: line["samples"] for line in lines}
    return {block.shard for block in job.blocks() if any(samples[n.model_id] for n in block.names)}


# --- Growth -----------------------------------------------------------------------------------


def _take_over(out: pathlib.Path, blocks: Iterable[Block], job: Job) -> None:
    """Reuses the results of earlier, smaller versions of a job in the folder.

    Unchanged blocks are marked as complete. The samples of models whose blocks have changed are
    written to the files of these models, as if they had just been rendered.

    Args:
      out: the folder.
      blocks: blocks of `job` that are to be completed.
      job: the job whose data set is written.
    """
    manifest = load_manifest(out, allow_incomplete=True)
    complete = manifest.complete and (out / REPORT).exists()
    lines = {line["model_id"]: line for line in read_report(out)} if complete else {}
    shards = {shard.file: shard for shard in manifest.shards}
    wanted: set[str] = set()
    for block in blocks:
        if _read_block(out, block) is not None:
            continue
        known = [lines[name.model_id] for name in block.names if name.model_id in lines]
        shard = shards.get(block.shard)
        if len(known) == len(block.names) and (shard or not any(x["samples"] for x in known)):
            _write_note(out, block, dataclasses.asdict(shard) if shard else None, known)
            if _read_block(out, block) is not None:
                continue
        names = (name.model_id for name in block.names)
        wanted |= {name for name in names if not _result_path(out, name).exists()}
    for file, old in _earlier_blocks(out, job, lines) if wanted else ():
        if wanted & {line["model_id"] for line in old}:
            for line, records in _samples(out / file, old):
                if line["model_id"] in wanted:
                    _write_result(out, line, records)


def _earlier_blocks(
    out: pathlib.Path, job: Job, lines: Mapping[str, Line]
) -> Iterator[tuple[str, list[Line]]]:
    """Names of shards that may exist in a folder, with the lines of their models.

    They are the shards of the complete data set and those of unfinished jobs.
    """
    for block in dataclasses.replace(job, names=tuple(_names(lines.values()))).blocks():
        yield block.shard, [lines[name.model_id] for name in block.names]
    for path in sorted((out / WORK).glob("*-*-*.json")):
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):  # rendered again
            content = read_json(path)
            if all(map(_is_line, content["lines"])):
                yield shard_of(content["shard"]).file if content["shard"] else "", content["lines"]


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
