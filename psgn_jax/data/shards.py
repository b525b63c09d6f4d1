"""Writes data sets that can be stopped, resumed, divided among processes and extended.

A function makes the samples of each input of a `Job`, in any order and in any process. Inputs are
divided into blocks of one split. When all inputs of a block are done, its samples go into a shard
for each split, and later calls skip the block. Conversion, variants and rendering use this.

The folder of a job:

    <split>-<number>-<digest>.arrayrecord   shard: samples of a block
    manifest.json                           the shards that readers see
    models.jsonl                            a line for each input, in the order of the inputs
    job.json                                what determines the samples besides the inputs
    .work/job.json                          the same of the job under way, with its inputs
    .work/<hash>.input                      line and samples of an input
    .work/<digest>.block                    lines and shards of a block

The digest of a block follows from the statement of the job and the tags of its inputs; in the names
of shards, also from the inputs whose status is not "ok". To extend a data set, we write new shards
next to the old ones and then replace the manifest, so readers see either the old or the new state.
Samples that exist are kept or copied, not made again.
"""

import contextlib
import dataclasses
import hashlib
import itertools
import json
import pathlib
import re
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import msgpack
from absl import logging

from psgn_jax.config import structured
from psgn_jax.data.dataset import ShardWriter, read_shard
from psgn_jax.data.manifest import MANIFEST, Manifest, Shard, load_manifest, save_manifest
from psgn_jax.data.schema import RecordError
from psgn_jax.system.claims import ClaimedError, claim
from psgn_jax.system.files import remove_temporaries, write_atomic
from psgn_jax.system.untrusted import one_line, parse_json, read_json

REPORT = "models.jsonl"
JOB = "job.json"
WORK = ".work"

_SHARD = re.compile(r"[a-z0-9_]+-[0-9]{5}-[0-9a-f]{8}\.arrayrecord")
_SECONDS_BETWEEN_REPORTS = 10

Line = Mapping[str, Any]
"""A line of `models.jsonl`: the fields of the input's `Tag`, `status` ("ok" if nothing is missing),
`reason`, and `samples`, their number. If the samples belong to other splits than the input,
`splits` has their numbers, in the order of the records."""


class OtherSettingsError(ValueError):
    """The folder holds a data set, complete or not, that was made with other settings."""


class Tag(NamedTuple):
    """What identifies an input: its name, category and split, and a version of its content."""

    model_id: str
    category: str
    split: str
    version: str = ""

    def __str__(self) -> str:
        return f"{self.model_id!r}, {self.category!r}, {self.split}"


class Result(NamedTuple):
    """The result of an input: its number in the job, its line, and its records."""

    number: int
    line: dict[str, Any]
    records: list[bytes]


Make = Callable[[Sequence[tuple[int, Any]]], Generator[Result]]
"""Makes the samples of numbered inputs, in any order."""


class _Block(NamedTuple):
    number: int  # in its split
    indices: tuple[int, ...]  # of its inputs, in order
    digest: str


class _Done(NamedTuple):
    """A finished block."""

    lines: list[Line]
    shards: list[Shard]


@dataclasses.dataclass(frozen=True)
class Job:
    """The specification of a data set.

    Attributes:
      statement: what determines the samples of an input, besides its tag. `source` goes into the
        manifest.
      inputs: tag of each input, and the argument of the function that makes its samples.
      per_shard: largest number of inputs of a shard.
      about: how the inputs were chosen, for `job.json` and for messages.
      converts: published data are converted, so inputs may vanish.
      tries_again: whether the next call tries a line's input again; False for the status "ok".
    """

    statement: Mapping[str, Any]
    inputs: Sequence[tuple[Tag, Any]]
    per_shard: int
    about: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    converts: bool = False
    tries_again: Callable[[Line], bool] = lambda line: False

    def tags(self) -> list[Tag]:
        return [tag for tag, _ in self.inputs]

    def blocks(self, tags: Sequence[Tag] | None = None) -> list[_Block]:
        """The blocks of the inputs, or of other tags, sorted by their first input."""
        tags = self.tags() if tags is None else tags
        by_split: dict[str, list[int]] = {}
        for index, tag in enumerate(tags):
            by_split.setdefault(tag.split, []).append(index)
        result = []
        for own in by_split.values():
            for number, start in enumerate(range(0, len(own), self.per_shard)):
                indices = tuple(own[start : start + self.per_shard])
                names = [tags[i] if tags[i].version else tags[i][:3] for i in indices]
                text = json.dumps([self.statement, names], sort_keys=True)
                digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:16]
                result.append(_Block(number, indices, digest))
        return sorted(result, key=lambda block: block.indices[0])


@dataclasses.dataclass(frozen=True)
class Progress:
    """What a call has done."""

    inputs: int  # in the job
    lines: tuple[Line, ...]  # of all inputs, or of those in shards if the job is not complete
    complete: bool  # all parts are done

    @property
    def samples(self) -> int:
        return sum(line["samples"] for line in self.lines)

    @property
    def statuses(self) -> dict[str, int]:
        """Number of inputs with each status; "open" are those that are not done."""
        counts = Counter(line["status"] for line in self.lines)
        left = self.inputs - len(self.lines)
        return dict(counts) | ({"open": left} if left else {})

    @property
    def exit_code(self) -> int:
        """0 complete; 1 something was refused; 2 no samples; 3 other parts are not finished."""
        if not self.complete:
            return 3
        return 2 if not self.samples else int(set(self.statuses) != {"ok"})


def write(folder: pathlib.Path, job: Job, make: Make, part: tuple[int, int] = (0, 1)) -> Progress:
    """Writes the data set of a job, or continues it.

    Args:
      part: (i, n): the i-th of n parts of the work, i from 0.

    Raises:
      OtherSettingsError: the folder contains a data set that the job cannot continue or extend.
      ClaimedError: another process does the same part.
      ValueError: the folder contains something else.
    """
    complete = is_complete(folder, job)
    if not complete:
        with claim(folder / WORK, part):
            complete = is_complete(folder, job)  # another process may have completed it meanwhile
            if not complete:
                _begin(folder, job)
                _make_part(folder, job, make, part)
                complete = _complete(folder, job)
    if complete and (folder / WORK).exists():
        # Not while another process extends the data set or tries inputs again.
        with contextlib.suppress(ClaimedError), claim(folder / WORK, part):
            _tidy_up(folder, job)
    lines = read_report(folder) if complete else _lines(job, _finished(folder, job))
    return Progress(len(job.inputs), tuple(lines), complete)


def _make_part(folder: pathlib.Path, job: Job, make: Make, part: tuple[int, int]) -> None:
    """Makes what is missing of a part."""
    started = time.monotonic()
    if part == (0, 1):
        remove_temporaries(folder / WORK)  # left by a process that was killed
    tags, finished = job.tags(), _finished(folder, job)
    blocks = job.blocks()[part[0] :: part[1]]
    fresh = [block for block in blocks if block.digest not in finished]
    _take_over(folder, job, [tags[i] for block in fresh for i in block.indices], finished)
    owner = {i: block for block in fresh for i in block.indices}
    todo = [i for i in owner if _read_result(folder, tags[i]) is None]
    missing = Counter(owner[i] for i in todo)
    for block in fresh:
        if not missing[block]:
            _write_block(folder, job, block)
    logging.info("%d of %d inputs to do", len(todo), len(tags))
    made = refused = 0
    reported = time.monotonic()
    with contextlib.closing(make([(i, job.inputs[i][1]) for i in todo])) as results:
        for done, (index, line, records) in enumerate(results if todo else (), 1):
            _write_result(folder, line, records)
            made += len(records)
            if line["status"] != "ok":
                refused += 1
                for what in line["reason"].split("\n"):
                    text = f"{line['status']}: {line['model_id']}: {what}"
                    logging.warning("%s", one_line(text))
            block = owner[index]
            missing[block] -= 1
            if not missing[block]:
                _write_block(folder, job, block)
            now = time.monotonic()
            if now - reported > _SECONDS_BETWEEN_REPORTS or done == len(todo):
                reported = now
                seconds = (now - started) / done * (len(todo) - done)
                logging.info(
                    "%d of %d inputs, %d samples, %.2f samples/s, %d refused, %d:%02d:%02d left",
                    done, len(todo), made, made / (now - started), refused,
                    seconds // 3600, seconds % 3600 // 60, seconds % 60,
                )  # fmt: skip


def _lines(job: Job, finished: Mapping[str, _Done]) -> list[Line]:
    """The lines of the finished blocks of a job, in the order of the inputs."""
    lines: dict[int, Line] = {}
    for block in job.blocks():
        if block.digest in finished:
            lines |= zip(block.indices, finished[block.digest].lines, strict=True)
    return [lines[i] for i in sorted(lines)]


def is_complete(folder: pathlib.Path, job: Job) -> bool:
    """Whether the data set of a job is complete in a folder; nothing is written.

    Raises:
      OtherSettingsError: the folder holds a data set that the job cannot continue or extend.
      ValueError: the folder holds something else.
    """
    if not folder.exists():
        return False
    if not (folder / MANIFEST).exists():
        if not all(path.name.startswith(".") for path in folder.iterdir()):
            raise ValueError(
                f"folder {str(folder)!r}: not empty and not a data set, expected an empty or new "
                "folder or a data set"
            )
    elif (manifest := load_manifest(folder, allow_incomplete=True)).complete:
        stated = specification(folder / JOB)
        if stated is None or not (folder / REPORT).exists():
            raise OtherSettingsError(
                f"folder {str(folder)!r}: contains a complete data set from {manifest.source!r} "
                f"without {REPORT if stated else JOB}, made by another command or an earlier "
                "version; give another folder, or remove it"
            )
        there = list(map(tag_of, read_report(folder)))
        _check_same(folder, stated[0], there, job, "contains a complete data set made with")
        kept = _kept(folder, job, manifest)
        if there == job.tags() and all(block.digest in kept for block in job.blocks()):
            return True
    unfinished = specification(folder / WORK / JOB)
    if unfinished is not None:
        _check_same(folder, *unfinished, job, "was started with")
    return False


def specification(path: pathlib.Path) -> tuple[dict[str, Any], list[Tag]] | None:
    """The content of a `job.json`, and the tags in it; None if it is missing or damaged."""
    try:
        stated = read_json(path)
        tags = [Tag(*map(str, tag)) for tag in stated.get("inputs", [])]
        sections = (stated["job"], stated.get("choice", {}), stated.get("moved", {}))
        return (stated, tags) if all(isinstance(s, dict) for s in sections) else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _check_same(
    folder: pathlib.Path, stated: Mapping[str, Any], there: Sequence[Tag], job: Job, what: str
) -> None:
    """Raises `OtherSettingsError` if a job cannot continue or extend the data set of a folder."""
    difference = _difference(stated["job"], job.statement).removeprefix("settings.")
    if difference:
        raise OtherSettingsError(
            f"folder {str(folder)!r}: {what} other settings ({difference}); give another folder, "
            "or remove it"
        )
    lost = [] if job.converts else sorted(set(there) - set(job.tags()), key=there.index)
    if lost:
        choice = _difference(stated.get("choice", {}), job.about.get("choice", {}))
        raise OtherSettingsError(
            f"folder {str(folder)!r}: {what} other models: {len(lost)} of its {len(there)} models "
            f"are not among the {len(job.inputs)} of this command, with the same category and "
            f"split ({'; '.join(map(str, lost[:3]))}{'; ...' * (len(lost) > 3)})"
            f"{choice and f'; --{choice}'}; a data set can get more models, but cannot lose any: "
            "give another folder, or remove it"
        )


def _difference(one: Any, two: Any, name: str = "") -> str:
    """The first field in which two specifications differ; "" if they are equal."""
    if isinstance(one, dict) and isinstance(two, dict):
        keys = sorted({*one, *two})
        texts = (_difference(one.get(k), two.get(k), f"{name}.{k}".lstrip(".")) for k in keys)
        return next(filter(None, texts), "")
    return "" if one == two else f"{name}: {one!r} before, {two!r} now"


def _begin(folder: pathlib.Path, job: Job) -> None:
    """Writes the specification of a job, and an empty manifest if there is none."""
    stated = {"job": job.statement, **job.about, "inputs": job.tags()}
    write_atomic(folder / WORK / JOB, json.dumps(stated) + "\n")
    if not (folder / MANIFEST).exists():
        save_manifest(folder, Manifest(job.statement["source"], False, ()))


def _complete(folder: pathlib.Path, job: Job) -> bool:
    """Completes the data set if all inputs are done; returns whether it is complete."""
    blocks, finished = job.blocks(), _finished(folder, job)
    if not all(block.digest in finished for block in blocks):
        return is_complete(folder, job)  # another part may have completed it
    unfinished = specification(folder / WORK / JOB)
    if unfinished is None or unfinished[1] != job.tags():
        raise RuntimeError(
            f"folder {str(folder)!r}: another command has started to add other models to it; the "
            "samples made so far are kept for that command"
        )
    lines = (json.dumps(line, ensure_ascii=False) for line in _lines(job, finished))
    text = "".join(f"{line}\n" for line in lines)
    # Characters that UTF-8 cannot encode are written as escapes of JSON.
    write_atomic(folder / REPORT, text.encode("utf-8", "backslashreplace"))
    write_atomic(folder / JOB, json.dumps({"job": job.statement, **job.about}, indent=1) + "\n")
    shards = [shard for block in blocks for shard in finished[block.digest].shards]
    shards.sort(key=lambda shard: shard.file)
    # Switches readers to the new state.
    save_manifest(folder, Manifest(job.statement["source"], True, tuple(shards)))
    return True


def _tidy_up(folder: pathlib.Path, job: Job) -> None:
    """Removes all other files from a complete data set; other parts may do so at once."""
    unfinished = specification(folder / WORK / JOB)
    if unfinished is not None and unfinished[1] != job.tags():
        return  # the data set is being extended
    kept = {shard.file for shard in load_manifest(folder).shards}
    remove_temporaries(folder)
    for path in folder.iterdir():
        if _SHARD.fullmatch(path.name) and path.name not in kept:
            path.unlink(missing_ok=True)
    for path in (folder / WORK).glob("*"):
        if path.name != JOB and path.suffix != ".lock":  # `claim` removes its own
            path.unlink(missing_ok=True)
    (folder / WORK / JOB).unlink(missing_ok=True)  # last, so that cleaning resumes after a kill


def _kept(folder: pathlib.Path, job: Job, manifest: Manifest) -> dict[str, _Done]:
    """The blocks of a complete data set by digest, except damaged ones.

    A block with inputs that are tried again is not finished: it has another key, for `_take_over`.
    """
    found: dict[str, _Done] = {}
    lines = read_report(folder) if manifest.complete else []
    for block in job.blocks(list(map(tag_of, lines))):
        own = [lines[i] for i in block.indices]
        shards = [shard for shard in manifest.shards if block.digest in shard.inputs]
        key = f"{block.digest} again" if any(map(job.tries_again, own)) else block.digest
        found[key] = _Done(own, shards)
    return {digest: done for digest, done in found.items() if _is_whole(folder, done)}


def _finished(folder: pathlib.Path, job: Job) -> dict[str, _Done]:
    """The finished blocks by digest: those of the complete data set, and of the job under way."""
    found = _kept(folder, job, load_manifest(folder, allow_incomplete=True))
    for path in (folder / WORK).glob("*.block"):
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):  # made again
            stated = read_json(path)
            shards = [structured.build(Shard, shard) for shard in stated["shards"]]
            done = _Done([_checked(line) for line in stated["lines"]], shards)
            if _is_whole(folder, done):
                found[path.stem] = done
    return found


def _is_whole(folder: pathlib.Path, done: _Done) -> bool:
    """Whether the shards of a block exist with all samples."""
    counts = sum((Counter(_counts(line)) for line in done.lines), Counter())
    paths = [(folder / shard.file, shard.size) for shard in done.shards]
    return counts == {shard.split: shard.count for shard in done.shards} and all(
        path.exists() and path.stat().st_size == size for path, size in paths
    )


def _write_block(folder: pathlib.Path, job: Job, block: _Block) -> None:
    """Writes the shards of a block from the results of its inputs, which it removes."""
    tags = [job.inputs[i][0] for i in block.indices]
    lines: list[Line] = []
    writers: dict[str, ShardWriter] = {}
    with contextlib.ExitStack() as stack:
        for tag in tags:
            result = _read_result(folder, tag)
            if result is None:
                what = "samples were damaged meanwhile; run the command again"
                raise ValueError(f"{folder / WORK}: {what}")
            lines.append(result[0])
            left = iter(result[1])
            for split, count in _counts(result[0]).items():
                if split not in writers:
                    writer = ShardWriter(folder, split, block.number, block.digest)
                    writers[split] = stack.enter_context(writer)
                for record in itertools.islice(left, count):
                    writers[split].write(record)
        # A later call may try these inputs again; the shards then need other names.
        if missing := [line["model_id"] for line in lines if line["status"] != "ok"]:
            digest = hashlib.sha256(json.dumps([block.digest, missing]).encode()).hexdigest()
            for writer in writers.values():
                writer.name_by(digest)
    shards = [dataclasses.asdict(writers[split].shard) for split in sorted(writers)]
    stated = {"lines": lines, "shards": shards}
    write_atomic(folder / WORK / f"{block.digest}.block", json.dumps(stated))
    for tag in tags:
        _result_path(folder, tag).unlink(missing_ok=True)


def _take_over(
    folder: pathlib.Path, job: Job, tags: Iterable[Tag], finished: Mapping[str, _Done]
) -> None:
    """Writes the results of inputs that are in finished blocks, as if they had just been made."""
    wanted = {tag for tag in tags if not _result_path(folder, tag).exists()}
    for done in finished.values():
        if wanted.isdisjoint(map(tag_of, done.lines)):
            continue
        try:
            records = {s.split: iter(read_shard(folder / s.file)) for s in done.shards}
        except RecordError:  # damaged: made again
            continue
        for line in done.lines:
            own = [
                record
                for split, count in _counts(line).items()
                for record in itertools.islice(records[split], count)
            ]
            same = tag_of(line) in wanted and len(own) == line["samples"]
            if same and not job.tries_again(line):
                _write_result(folder, line, own)


def _result_path(folder: pathlib.Path, tag: Tag) -> pathlib.Path:
    text = json.dumps(tag).encode()
    return folder / WORK / f"{hashlib.sha256(text).hexdigest()[:24]}.input"


def _write_result(folder: pathlib.Path, line: Line, records: Sequence[bytes]) -> None:
    packed = msgpack.packb({"line": json.dumps(line), "records": list(records)})
    write_atomic(_result_path(folder, tag_of(line)), packed, sync=False)


def _read_result(folder: pathlib.Path, tag: Tag) -> tuple[Line, list[bytes]] | None:
    """The line and the records of an input; None if they are missing or damaged."""
    try:
        content = msgpack.unpackb(_result_path(folder, tag).read_bytes())
        return _checked(parse_json(content["line"])), list(content["records"])
    except Exception:  # msgpack raises many types of errors
        return None


def read_report(folder: pathlib.Path) -> list[Line]:
    """The lines of a complete data set; ValueError if the file is damaged."""
    try:
        lines = (folder / REPORT).read_bytes().split(b"\n")
        return [_checked(parse_json(line)) for line in lines if line]
    except (OSError, ValueError) as error:
        raise ValueError(
            f"{folder / REPORT}: damaged ({one_line(error)}); make the data set again"
        ) from None


def _checked(line: Any) -> Line:
    """A line with the fields that this module reads; ValueError if one is missing."""
    if not (
        isinstance(line, dict)
        and all(isinstance(line.get(k), str) for k in ("model_id", "category", "split", "status"))
        and isinstance(line.get("samples"), int)
        and isinstance(line.get("splits", {}), dict)
        and sum(_counts(line).values()) == line["samples"] >= 0
    ):
        raise ValueError("a line does not describe an input")
    return line


def tag_of(line: Line) -> Tag:
    return Tag(line["model_id"], line["category"], line["split"], line.get("version", ""))


def _counts(line: Line) -> dict[str, int]:
    """The numbers of samples of an input by split, without zeros."""
    counts = line.get("splits") or {line["split"]: line["samples"]}
    return {split: count for split, count in counts.items() if count}
