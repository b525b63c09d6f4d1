"""The folder of a rendering job: what it is for, what is done, and how it becomes a data set.

    <split>-<number>-<digest>.arrayrecord   samples of a block of models
    manifest.json                           the shards that readers see
    models.jsonl                            a line for each model, in the catalogue's order
    job.json                                settings, and how the models were chosen
    .work/                                  only while the job is under way

A block's digest is that of the settings and of its models' names, and a shard carries it in its
name. So a data set that grows writes new shards beside those that readers see, and the one step
that replaces the manifest takes readers from the old state to the new one. Shards whose block stays
as it is are kept; samples of the others are copied, not rendered again.
"""

import contextlib
import dataclasses
import json
import pathlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from absl import logging

from data_gen.blocks import Block, Job, Name
from data_gen.results import pack_result, read_result, work_path, write_result
from psgn_jax.data.codec import decode, unpack
from psgn_jax.data.dataset import ShardWriter, read_shard
from psgn_jax.data.manifest import MANIFEST, Manifest, Shard, load_manifest, save_manifest, shard_of
from psgn_jax.files import remove_temporaries, write_atomic
from psgn_jax.untrusted import one_line, parse_json, read_json

REPORT = "models.jsonl"

JOB = "job.json"

WORK = ".work"

_SHARD = re.compile(r"[a-z0-9_]+-[0-9]{5}-[0-9a-f]{8}\.arrayrecord")


class OtherSettingsError(ValueError):
    """The folder holds a data set, complete or begun, that was made with other settings."""


# --- What the folder is for -------------------------------------------------------------------


def _difference(one: Any, two: Any, name: str = "") -> str:
    """The first field in which two statements differ."""
    if isinstance(one, dict) and isinstance(two, dict):
        for key in sorted({*one, *two}):
            found = _difference(one.get(key), two.get(key), f"{name}.{key}" if name else key)
            if found:
                return found
        return ""
    return "" if one == two else f"{name}: {one!r} there, {two!r} now"


def _first(names: Sequence[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:3])
    return shown + (", ..." if len(names) > 3 else "")


def _lost_models(there: Sequence[Name], now: Sequence[Name]) -> str:
    """How the models of a data set are not all among those of a job; "" where they are."""
    old, new = ({name.model_id: name for name in names} for names in (there, now))
    gone = [key for key in old if key not in new]
    if gone:
        text = f"{len(gone)} of its {len(old)} models are not among the {len(new)} of now "
        text += f"({_first(gone)})"
        added = [key for key in new if key not in old]
        return text + (f", {len(added)} are new ({_first(added)})" if added else "")
    for field in ("category", "split"):
        other = [key for key in old if getattr(old[key], field) != getattr(new[key], field)]
        if other:
            one, two = getattr(old[other[0]], field), getattr(new[other[0]], field)
            return (
                f"{len(other)} of its models have another {field} ({other[0]!r}: {one!r} there, "
                f"{two!r} now)"
            )
    return ""


def _check_same(
    out: pathlib.Path, stated: Mapping[str, Any], there: Sequence[Name], job: Job, what: str
) -> None:
    """Raises `OtherSettingsError` where a job cannot go on with what a folder holds."""
    if not isinstance(stated.get("job"), dict):
        raise OtherSettingsError(
            f"--out {str(out)!r}: {what} an earlier version; give another folder, or remove it"
        )
    difference = _difference(stated["job"], job.statement)
    if difference:
        difference = difference.removeprefix("settings.")
        raise OtherSettingsError(
            f"--out {str(out)!r}: {what} other settings ({difference}); give another folder, or "
            "remove it"
        )
    lost = _lost_models(there, job.names)
    if lost:
        choice = _difference(dict(stated.get("choice", {})), dict(job.choice))
        raise OtherSettingsError(
            f"--out {str(out)!r}: {what} other models: {lost}{choice and f'; --{choice}'}; it can "
            "grow by further models, but not lose any: give another folder, or remove it"
        )


def _read_json(path: pathlib.Path) -> Any:
    try:
        return read_json(path)
    except (OSError, ValueError):
        return None


def _begun(out: pathlib.Path) -> tuple[Mapping[str, Any], list[Name]] | None:
    """The statement of the job that is under way, and its models."""
    stated = _read_json(out / WORK / JOB)
    if not isinstance(stated, dict):
        return None
    if "job" not in stated:  # an earlier version wrote other fields
        return stated, []
    models = stated.get("models")
    if not isinstance(models, list) or not all(
        isinstance(name, list) and len(name) == 3 and all(isinstance(text, str) for text in name)
        for name in models
    ):
        return None
    return stated, [Name(*name) for name in models]


def read_report(out: pathlib.Path) -> list[Mapping[str, Any]]:
    """The models' lines of a complete data set.

    Raises:
      ValueError: the file is damaged.
    """
    try:
        lines = [parse_json(line) for line in (out / REPORT).read_bytes().split(b"\n") if line]
        if not all(map(_is_line, lines)):
            raise ValueError("a line is not that of a model")
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


def _names(lines: Iterable[Mapping[str, Any]]) -> list[Name]:
    return [Name(line["model_id"], line["category"], line["split"]) for line in lines]


def _is_manifest_of(manifest: Manifest, job: Job, lines: Sequence[Mapping[str, Any]]) -> bool:
    """Whether the shards of a data set are those of a job, whose models' lines are given."""
    samples = {line["model_id"]: line["samples"] for line in lines}
    expected = {
        block.shard for block in job.blocks() if any(samples[n.model_id] for n in block.names)
    }
    return expected == {shard.file for shard in manifest.shards}


def check(out: pathlib.Path, job: Job) -> bool:
    """Whether a job's data set is complete in a folder; nothing is written.

    Raises:
      OtherSettingsError: the folder holds a data set that the job cannot go on with.
      ValueError: it holds something else.
    """
    if not out.exists():
        return False
    if (out / MANIFEST).exists():
        manifest = load_manifest(out, allow_incomplete=True)
        if manifest.complete:
            stated = _read_json(out / JOB)
            if not isinstance(stated, dict) or not (out / REPORT).exists():
                missing = REPORT if isinstance(stated, dict) else JOB
                raise OtherSettingsError(
                    f"--out {str(out)!r}: holds a complete data set without {missing}, of another "
                    "command or an earlier version; give another folder, or remove it"
                )
            lines = read_report(out)
            there = _names(lines)
            _check_same(out, stated, there, job, "holds a complete data set made with")
            if there == list(job.names) and _is_manifest_of(manifest, job, lines):
                return True
    elif (
        any(not p.name.startswith(".") for p in out.iterdir())
        and not (
            out / MANIFEST  # of another part, since
        ).exists()
    ):
        raise ValueError(f"--out {str(out)!r}: not empty and not a data set")
    begun = _begun(out)
    if begun:
        _check_same(out, begun[0], begun[1], job, "was begun with")
    return False


def begin(out: pathlib.Path, job: Job) -> bool:
    """Makes or checks a job's folder, as `check`, and says in it what the job is."""
    if check(out, job):
        tidy_up(out, job)
        return True
    begun = _begun(out)
    if begun is None or begun[1] != list(job.names):
        stated = {"job": job.statement, "choice": job.choice, "models": job.names}
        write_atomic(out / WORK / JOB, json.dumps(stated) + "\n")
    if not (out / MANIFEST).exists():
        save_manifest(out, Manifest(job.source, False, ()))
    return False


# --- Blocks -----------------------------------------------------------------------------------


def finish_block(out: pathlib.Path, block: Block) -> None:
    """Writes a block's shard from its models' files and says that it is done."""
    sources = [work_path(out / WORK, name.model_id) for name in block.names]
    results = [read_result(path) for path in sources]
    shard = None
    if any(data for _, data in results):
        with ShardWriter(
            out, block.split, block.number, (block.digest,), tag=block.digest[:8]
        ) as writer:
            for _, data in results:
                for record in data:
                    writer.write(record, decode(record))
        shard = writer.shard
    _note(out, block, shard, [line for line, _ in results])
    for path in sources:
        path.unlink(missing_ok=True)


def _note(
    out: pathlib.Path, block: Block, shard: Shard | None, lines: Sequence[Mapping[str, Any]]
) -> None:
    content = {"shard": None if shard is None else dataclasses.asdict(shard), "lines": lines}
    write_atomic(out / WORK / block.note, json.dumps(content) + "\n")


def read_block(out: pathlib.Path, block: Block) -> dict[str, Any] | None:
    """What `finish_block` has said; None if the block is not done or its shard is not whole."""
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


def take_over(out: pathlib.Path, blocks: Iterable[Block], job: Job) -> None:
    """Takes what a folder holds of earlier, smaller states of a job.

    Blocks that stay as they are count as done. Samples of models whose blocks have changed become
    the models' files, as if they had just been rendered.

    Args:
      out: the folder.
      blocks: those to be done, of `job`.
      job: whose data set is made.
    """
    manifest = load_manifest(out, allow_incomplete=True)
    lines: Mapping[str, Mapping[str, Any]] = {}
    if manifest.complete and (out / REPORT).exists():
        lines = {line["model_id"]: line for line in read_report(out)}
    shards = {shard.file: shard for shard in manifest.shards}
    wanted: set[str] = set()
    for block in blocks:
        if read_block(out, block) is not None:
            continue
        own = [lines.get(name.model_id) for name in block.names]
        shard = shards.get(block.shard)
        known = [line for line in own if line is not None]
        if len(known) == len(own) and (shard or not any(line["samples"] for line in known)):
            _note(out, block, shard, known)
            if read_block(out, block) is not None:
                continue
        wanted |= {
            name.model_id for name in block.names
            if not work_path(out / WORK, name.model_id).exists()
        }  # fmt: skip
    if not wanted:
        return
    for file, old in _earlier_blocks(out, job, list(lines.values())):
        if wanted & {line["model_id"] for line in old}:
            for line, data in _samples(out / file, old):
                if line["model_id"] in wanted:
                    write_result(out / WORK, line["model_id"], pack_result(line, data))


def _earlier_blocks(
    out: pathlib.Path, job: Job, lines: Sequence[Mapping[str, Any]]
) -> Iterator[tuple[str, list[Mapping[str, Any]]]]:
    """Shards that a folder may hold, complete or begun, and their models' lines."""
    by_name = {line["model_id"]: line for line in lines}
    for block in dataclasses.replace(job, names=tuple(_names(lines))).blocks():
        yield block.shard, [by_name[name.model_id] for name in block.names]
    for path in sorted((out / WORK).glob("*-*-*.json")):
        content = _read_json(path)
        try:
            shard = shard_of(content["shard"]).file if content["shard"] else ""
            if all(map(_is_line, content["lines"])):
                yield shard, content["lines"]
        except (ValueError, KeyError, TypeError):
            continue  # damaged: rendered again


def _samples(
    path: pathlib.Path, lines: Sequence[Mapping[str, Any]]
) -> list[tuple[Mapping[str, Any], list[bytes]]]:
    """A shard's records by model; nothing where it is not what the lines say."""
    data: list[bytes] = []
    if any(line["samples"] for line in lines):
        try:
            data = read_shard(path)
            owners = [unpack(record)["model_id"] for record in data]
        except (ValueError, KeyError):  # gone or damaged: rendered again
            return []
        if owners != [line["model_id"] for line in lines for _ in range(line["samples"])]:
            return []
    result, start = [], 0
    for line in lines:
        result.append((line, data[start : start + line["samples"]]))
        start += line["samples"]
    return result


# --- The end ----------------------------------------------------------------------------------


def complete(
    out: pathlib.Path, job: Job, blocks: Sequence[Block]
) -> tuple[list[Mapping[str, Any]], bool]:
    """Completes the data set if all blocks are done; returns the lines there are, in order.

    Raises:
      RuntimeError: another command has begun to make something else in the folder.
    """
    contents = [read_block(out, block) for block in blocks]
    numbered = sorted(
        (
            (index, line)
            for block, content in zip(blocks, contents, strict=True)
            if content is not None
            for index, line in zip(block.indices, content["lines"], strict=True)
        ),
        key=lambda pair: pair[0],
    )
    lines = [line for _, line in numbered]
    begun = _begun(out)
    if len(lines) < len(job.names):
        if begun is None and check(out, job):
            return read_report(out), True  # another part was last, and has tidied up
        return lines, False
    if begun is None or begun[1] != list(job.names):
        if begun is None and check(out, job):
            return lines, True
        raise RuntimeError(
            f"--out {str(out)!r}: another command has begun to make it of other models meanwhile; "
            "what is rendered is kept for it"
        )
    text = "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines)
    # What no UTF-8 can hold becomes an escape, which JSON understands.
    write_atomic(out / REPORT, text.encode("utf-8", "backslashreplace"))
    stated = {"job": job.statement, "choice": job.choice}
    write_atomic(out / JOB, json.dumps(stated, indent=1) + "\n")
    shards = sorted(
        (content["shard"] for content in contents if content and content["shard"]),
        key=lambda shard: str(shard["file"]),
    )
    manifest = Manifest(
        job.source,
        True,
        tuple(map(shard_of, shards)),
    )
    # From here on readers see the new state.
    save_manifest(out, manifest)
    tidy_up(out, job)
    return lines, True


def tidy_up(out: pathlib.Path, job: Job) -> None:
    """Removes what is no part of a complete data set; another part may be at the same."""
    begun = _begun(out)
    if begun is None:
        with contextlib.suppress(OSError):
            (out / WORK).rmdir()  # left by a kill at the very end
        return
    if begun[1] != list(job.names):
        return  # the data set is growing
    kept = {shard.file for shard in load_manifest(out).shards}
    remove_temporaries(out)
    for path in out.iterdir():
        if _SHARD.fullmatch(path.name) and path.name not in kept:
            path.unlink(missing_ok=True)
    for path in (out / WORK).glob("*"):
        if path.name != JOB:
            path.unlink(missing_ok=True)
    (out / WORK / JOB).unlink(missing_ok=True)  # last, so that a kill leaves a folder to tidy up
    try:
        (out / WORK).rmdir()
    except OSError:
        logging.info("%s is left to another part of the job", out / WORK)
