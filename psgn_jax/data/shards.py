"""Writes data sets by jobs that can be stopped, resumed and divided among processes.

A `Job` has inputs, such as models. A function makes the samples of each input, in any order and in
any process. The inputs of a split are divided into blocks. When all inputs of a block are made, its
samples are written to one shard per split, and later calls skip the block. A stopped block is begun
again. Conversion and rendering use this.

The folder of a job:

    <split>-<number>-<CRC-32>.arrayrecord   shard: samples of a block
    manifest.json                           the shards that readers see
    models.jsonl                            a line for each input, in the order of the inputs
    job.json                                the statement of the job and its inputs
    .work/<digest>.block                    lines and shards of a block, until all are made

A block's digest hashes the statement of the job and the tags of the block's inputs. If blocks of a
complete data set are made again, we write new shards beside the old ones and then replace the
manifest, so readers see either the old or the new state.
"""

import contextlib
import dataclasses
import hashlib
import json
import pathlib
import re
import time
from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any, NamedTuple

from absl import logging

from psgn_jax.config import structured
from psgn_jax.data.dataset import ShardWriter, check_shard
from psgn_jax.data.manifest import MANIFEST, Manifest, Shard, load_manifest, save_manifest
from psgn_jax.data.schema import RecordError
from psgn_jax.system.errors import Exit
from psgn_jax.system.files import remove_temporaries, write_atomic
from psgn_jax.system.locks import TakenError, lock_part
from psgn_jax.system.untrusted import one_line, parse_json, read_json, size_of

REPORT = "models.jsonl"
JOB = "job.json"
WORK = ".work"

_SHARD = re.compile(r"[a-z0-9_]+-[0-9]{5}-[0-9a-f]{8}\.arrayrecord")
_SECONDS_BETWEEN_REPORTS = 10

Line = Mapping[str, Any]
"""A line of `models.jsonl`: the fields of the input's `Tag`, `status` ("ok" if nothing is missing),
`reason`, and `samples`, the number of its samples. If they are in other splits than the input,
`splits` maps each split to its number of samples."""


class OtherSettingsError(ValueError):
    """The folder has a data set, complete or not, that was made with other settings."""


class Tag(NamedTuple):
    """Identifies an input: name, category, split, and a version of the content."""

    model_id: str
    category: str
    split: str
    version: str = ""

    def __str__(self) -> str:
        return f"{self.model_id!r}, {self.category!r}" + (self.split and f", {self.split}")


class Result(NamedTuple):
    """The result of an input: its number in the job, its line, and its records by split."""

    number: int
    line: dict[str, Any]
    records: Mapping[str, Sequence[bytes]]


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
      statement: what determines an input's samples besides its tag. Its `source` goes into the
        manifest.
      inputs: for each input, its tag and the argument of the function that makes its samples.
      per_shard: largest number of inputs of a shard.
      about: how the inputs were chosen, for `job.json` and messages.
      converts: whether inputs may change, as in a conversion of published data.
      tries_again: whether the next call makes a line's block again; False for the status "ok".
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
        """The blocks of `tags` (None = of the inputs), sorted by their first input."""
        tags = self.tags() if tags is None else tags
        by_split: dict[str, list[int]] = {}
        for index, tag in enumerate(tags):
            by_split.setdefault(tag.split, []).append(index)
        result = []
        for members in by_split.values():
            for number, start in enumerate(range(0, len(members), self.per_shard)):
                indices = tuple(members[start : start + self.per_shard])
                names = [tags[i] if tags[i].version else tags[i][:3] for i in indices]
                text = json.dumps([self.statement, names], sort_keys=True)
                digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:16]
                result.append(_Block(number, indices, digest))
        return sorted(result, key=lambda block: block.indices[0])


@dataclasses.dataclass(frozen=True)
class Progress:
    """The state of a job after a call."""

    inputs: int  # number of inputs of the job
    lines: tuple[Line, ...]  # of all inputs; of an incomplete job, of the inputs in shards
    complete: bool  # whether all parts are done

    @property
    def samples(self) -> int:
        return sum(line["samples"] for line in self.lines)

    @property
    def statuses(self) -> dict[str, int]:
        """Status -> number of inputs; "open" inputs are not done."""
        counts = Counter(line["status"] for line in self.lines)
        left = self.inputs - len(self.lines)
        return dict(counts) | ({"open": left} if left else {})

    @property
    def exit_code(self) -> int:
        if not self.complete:
            return Exit.INCOMPLETE
        if not self.samples:
            return Exit.ERROR
        return Exit.DONE if set(self.statuses) == {"ok"} else Exit.PARTLY


def write(folder: pathlib.Path, job: Job, make: Make, part: tuple[int, int] = (0, 1)) -> Progress:
    """Writes the data set of a job, or continues it; `part` (i, n) is part i < n of the work.

    `OtherSettingsError` if the folder has the data set of another job, `TakenError` if another
    process works on the same part, ValueError if the folder has other content.
    """
    complete = is_complete(folder, job)
    if not complete:
        with lock_part(folder / WORK, part):
            complete = is_complete(folder, job)  # another process may have completed it
            if not complete:
                _begin(folder, job)
                _make_part(folder, job, make, part)
                complete = _complete(folder, job)
    if complete and (folder / WORK).exists():
        # If another process tries inputs again, it tidies up later.
        with contextlib.suppress(TakenError), lock_part(folder / WORK, part):
            _tidy_up(folder)
    lines = read_report(folder) if complete else _lines(job, _finished(folder, job))
    return Progress(len(job.inputs), tuple(lines), complete)


def _make_part(folder: pathlib.Path, job: Job, make: Make, part: tuple[int, int]) -> None:
    """Makes the unfinished blocks of a part."""
    started = reported = time.monotonic()
    finished = _finished(folder, job)
    todo = [b for b in job.blocks()[part[0] :: part[1]] if b.digest not in finished]
    owner = {i: block for block in todo for i in block.indices}
    results: dict[str, dict[int, Result]] = {}
    logging.info("%d of %d inputs to do", len(owner), len(job.inputs))
    made = refused = 0
    with contextlib.closing(make([(i, job.inputs[i][1]) for i in owner])) as all_results:
        for number, result in enumerate(all_results if owner else (), 1):
            block, line = owner[result.number], result.line
            made += line["samples"]
            if line["status"] != "ok":
                refused += 1
                for what in line["reason"].split("\n"):
                    text = f"{line['status']}: {line['model_id']}: {what}"
                    logging.warning("%s", one_line(text))
            results.setdefault(block.digest, {})[result.number] = result
            if len(results[block.digest]) == len(block.indices):
                _write_block(folder, block, results.pop(block.digest))
            now = time.monotonic()
            if now - reported > _SECONDS_BETWEEN_REPORTS or number == len(owner):
                reported = now
                seconds = (now - started) / number * (len(owner) - number)
                logging.info(
                    "%d of %d inputs, %d samples, %.2f samples/s, %d refused, %d:%02d:%02d left",
                    number, len(owner), made, made / (now - started), refused,
                    seconds // 3600, seconds % 3600 // 60, seconds % 60,
                )  # fmt: skip


def _write_block(folder: pathlib.Path, block: _Block, results: Mapping[int, Result]) -> None:
    """Writes the shards of a block, then its lines."""
    ordered, shards = [results[i] for i in block.indices], []
    for split in sorted({split for result in ordered for split in _counts(result.line)}):
        with ShardWriter(folder, split, block.number, block.digest) as writer:
            for result in ordered:
                for record in result.records.get(split, ()):
                    writer.write(record)
        shards.append(dataclasses.asdict(writer.shard))
    stated = {"lines": [result.line for result in ordered], "shards": shards}
    write_atomic(folder / WORK / f"{block.digest}.block", json.dumps(stated))


def _lines(job: Job, finished: Mapping[str, _Done]) -> list[Line]:
    """The lines of finished blocks, in the order of the inputs."""
    lines: dict[int, Line] = {}
    for block in job.blocks():
        if block.digest in finished:
            lines |= zip(block.indices, finished[block.digest].lines, strict=True)
    return [lines[i] for i in sorted(lines)]


def is_complete(folder: pathlib.Path, job: Job) -> bool:
    """Whether a folder has the complete data set of a job; errors as in `write`."""
    if not folder.exists():
        return False
    if not (folder / MANIFEST).exists():
        if not all(path.name.startswith(".") or path.name == JOB for path in folder.iterdir()):
            raise ValueError(
                f"folder {str(folder)!r}: not empty and not a data set, expected an empty or new "
                "folder or a data set"
            )
        return False
    manifest = load_manifest(folder, allow_incomplete=True)
    try:
        stated = read_json(folder / JOB)
        statement, choice = dict(stated["job"]), dict(stated.get("choice", {}))
        # Earlier versions do not state the inputs of a complete data set.
        there = [Tag(*map(str, tag)) for tag in stated.get("inputs", [])]
        lines = read_report(folder) if manifest.complete else []
        if manifest.complete:
            there = list(map(tag_of, lines))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        why = (isinstance(error, OSError) and error.strerror) or one_line(error)
        raise OtherSettingsError(
            f"folder {str(folder)!r}: contains a data set from {manifest.source!r} without a "
            f"readable {JOB} and {REPORT} ({why}), made by another command or an earlier version; "
            "give another folder, or remove it"
        ) from error
    made = [tag_of(line) for line in lines if line["samples"]] if job.converts else there
    _check_same(folder, statement, choice, made, job)
    kept = _kept(folder, job) if manifest.complete and there == job.tags() else {}
    return bool(kept) and all(block.digest in kept for block in job.blocks())


def _check_same(
    folder: pathlib.Path, statement: Any, choice: Any, there: Sequence[Tag], job: Job
) -> None:
    """Raises `OtherSettingsError` if a folder's data set belongs to another job."""
    difference = _difference(statement, job.statement).removeprefix("settings.")
    if difference:
        raise OtherSettingsError(
            f"folder {str(folder)!r}: contains a data set made with other settings ({difference}); "
            "give another folder, or remove it"
        )
    # A conversion may get new and changed inputs; the samples of missing ones would be removed.
    before, now = there, job.tags()
    if job.converts:
        before, now = ([Tag(tag.model_id, tag.category, "") for tag in x] for x in (before, now))
    lost = sorted(set(before).difference(now), key=before.index)
    if lost or (not job.converts and before != now):
        more = sorted(set(now).difference(before), key=now.index)
        choice = _difference(choice, job.about.get("choice", {}))
        raise OtherSettingsError(
            f"folder {str(folder)!r}: contains a data set made with other models: {len(lost)} of "
            f"its {len(there)} models are not among the {len(job.inputs)} of this command, with "
            "the same category and split, and "
            f"{len(more)} are new ({'; '.join(map(str, [*lost, *more][:3]))})"
            f"{choice and f'; --{choice}'}; give another folder: data.path=a,b reads two"
        )


def _difference(one: Any, two: Any, name: str = "") -> str:
    """The first field in which two specifications differ; "" if they are equal."""
    if isinstance(one, dict) and isinstance(two, dict):
        keys = sorted({*one, *two})
        texts = (_difference(one.get(k), two.get(k), f"{name}.{k}".lstrip(".")) for k in keys)
        return next(filter(None, texts), "")
    same = json.dumps(one) == json.dumps(two)  # JSON stores a tuple as a list
    return "" if same else f"{name}: {one!r} before, {two!r} now"


def _begin(folder: pathlib.Path, job: Job) -> None:
    """Writes the specification of a job, and an empty manifest if there is none."""
    stated = {"job": job.statement, **job.about, "inputs": job.tags()}
    write_atomic(folder / JOB, json.dumps(stated) + "\n")
    if not (folder / MANIFEST).exists():
        save_manifest(folder, Manifest(job.statement["source"], False, ()))


def _complete(folder: pathlib.Path, job: Job) -> bool:
    """Completes the data set if all blocks are finished; returns whether it is complete."""
    blocks, finished = job.blocks(), _finished(folder, job)
    if not all(block.digest in finished for block in blocks):
        return is_complete(folder, job)  # another part may have completed it
    lines = (json.dumps(line, ensure_ascii=False) for line in _lines(job, finished))
    text = "".join(f"{line}\n" for line in lines)
    # Characters that UTF-8 cannot encode are written as escapes of JSON.
    write_atomic(folder / REPORT, text.encode("utf-8", "backslashreplace"))
    shards = [shard for block in blocks for shard in finished[block.digest].shards]
    shards.sort(key=lambda shard: shard.file)
    save_manifest(folder, Manifest(job.statement["source"], True, tuple(shards)))  # readers switch
    return True


def _tidy_up(folder: pathlib.Path) -> None:
    """Removes all other files from a complete data set; other processes may do so, too."""
    kept = {shard.file for shard in load_manifest(folder).shards}
    remove_temporaries(folder)
    for path in folder.iterdir():
        if _SHARD.fullmatch(path.name) and path.name not in kept:
            path.unlink(missing_ok=True)
    for path in (folder / WORK).glob("*"):
        if path.suffix != ".lock":  # `lock_part` removes its own
            path.unlink(missing_ok=True)


def _kept(folder: pathlib.Path, job: Job) -> dict[str, _Done]:
    """Digest -> block of a complete data set, without damaged blocks and blocks to try again."""
    manifest = load_manifest(folder, allow_incomplete=True)
    lines = read_report(folder) if manifest.complete else []
    found: dict[str, _Done] = {}
    for block in job.blocks(list(map(tag_of, lines))):
        shards = [shard for shard in manifest.shards if block.digest in shard.inputs]
        done = _Done([lines[i] for i in block.indices], shards)
        if not any(map(job.tries_again, done.lines)) and _is_whole(folder, done):
            found[block.digest] = done
    return found


def _finished(folder: pathlib.Path, job: Job) -> dict[str, _Done]:
    """Digest -> finished block of the complete data set or of the current job."""
    found = _kept(folder, job)
    for path in (folder / WORK).glob("*.block"):
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):  # it is made again
            stated = read_json(path)
            shards = [structured.build(Shard, shard) for shard in stated["shards"]]
            done = _Done([_checked(line) for line in stated["lines"]], shards)
            if _is_whole(folder, done):
                found[path.stem] = done
    return found


def _is_whole(folder: pathlib.Path, done: _Done) -> bool:
    """Whether the shards of a block exist and have all samples."""
    counts = sum((Counter(_counts(line)) for line in done.lines), Counter())
    try:
        for shard in done.shards:
            check_shard(folder / shard.file, shard)
    except RecordError:
        return False
    return counts == {shard.split: shard.count for shard in done.shards}


def read_report(folder: pathlib.Path) -> list[Line]:
    """The lines of `models.jsonl`; ValueError if the file is damaged."""
    try:
        size_of(folder / REPORT)
        lines = (folder / REPORT).read_bytes().split(b"\n")
        return [_checked(parse_json(line)) for line in lines if line]
    except (OSError, ValueError) as error:
        why = (isinstance(error, OSError) and error.strerror) or one_line(error)
        raise ValueError(f"{folder / REPORT}: damaged ({why}); make the data set again") from None


def _checked(line: Any) -> Line:
    """The line, if it has the fields that this module reads; otherwise ValueError."""
    if not (
        isinstance(line, dict)
        and all(isinstance(line.get(k), str) for k in ("model_id", "category", "split", "status"))
        and isinstance(line.get("reason", ""), str)
        and isinstance(line.get("samples"), int)
        and isinstance(line.get("splits", {}), dict)
        and sum(_counts(line).values()) == line["samples"] >= 0
    ):
        raise ValueError("a line does not describe an input")
    return line


def tag_of(line: Line) -> Tag:
    return Tag(line["model_id"], line["category"], line["split"], line.get("version", ""))


def _counts(line: Line) -> dict[str, int]:
    """Split -> number of samples of an input, without zeros."""
    counts = line.get("splits") or {line["split"]: line["samples"]}
    return {split: count for split, count in counts.items() if count}
