"""The folder of a rendering job: its specification, its progress, and the resulting data set.

    <split>-<number>-<digest>.arrayrecord   samples of a block of models
    manifest.json                           the shards that readers see
    models.jsonl                            a line for each model, in the catalogue's order
    job.json                                settings, and how the models were chosen
    .work/                                  only while the job is under way

The digest of a block is computed from the settings and the names of its models, and is part of the
name of the shard. When a data set is extended, new shards are written next to the existing ones,
and the manifest is then replaced, which switches readers to the new state atomically. Shards of
unchanged blocks are kept. The samples of other existing shards are copied, not rendered again.
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
    """The folder holds a data set, complete or not, that was rendered with other settings."""


# --- Specification of the job -----------------------------------------------------------------


def _difference(one: Any, two: Any, name: str = "") -> str:
    """The first field in which two specifications differ; "" if they are equal."""
    if isinstance(one, dict) and isinstance(two, dict):
        for key in sorted({*one, *two}):
            text = _difference(one.get(key), two.get(key), f"{name}.{key}" if name else key)
            if text:
                return text
        return ""
    return "" if one == two else f"{name}: {one!r} before, {two!r} now"


def _first(names: Sequence[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:3])
    return shown + (", ..." if len(names) > 3 else "")


def _lost_models(there: Sequence[Name], now: Sequence[Name]) -> str:
    """Describes models of a data set that a job lacks or changes; "" if there are none."""
    old, new = ({name.model_id: name for name in names} for names in (there, now))
    gone = [key for key in old if key not in new]
    if gone:
        text = f"{len(gone)} of its {len(old)} models are not among the {len(new)} models of this "
        text += f"command ({_first(gone)})"
        added = [key for key in new if key not in old]
        return text + (f", {len(added)} are new ({_first(added)})" if added else "")
    for field in ("category", "split"):
        other = [key for key in old if getattr(old[key], field) != getattr(new[key], field)]
        if other:
            one, two = getattr(old[other[0]], field), getattr(new[other[0]], field)
            return (
                f"{len(other)} of its models have another {field} ({other[0]!r}: {one!r} before, "
                f"{two!r} now)"
            )
    return ""


def _check_same(
    out: pathlib.Path, stated: Mapping[str, Any], there: Sequence[Name], job: Job, what: str
) -> None:
    """Raises `OtherSettingsError` if a job cannot continue or extend the data set of a folder."""
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
            f"--out {str(out)!r}: {what} other models: {lost}{choice and f'; --{choice}'}; a "
            "data set can get more models, but cannot lose any: give another folder, or remove it"
        )


def _read_json(path: pathlib.Path) -> Any:
    try:
        return read_json(path)
    except (OSError, ValueError):
        return None


def _unfinished(out: pathlib.Path) -> tuple[Mapping[str, Any], list[Name]] | None:
    """The specification of the unfinished job in a folder, and its models; None without one."""
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


def _names(lines: Iterable[Mapping[str, Any]]) -> list[Name]:
    return [Name(line["model_id"], line["category"], line["split"]) for line in lines]


def _is_manifest_of(manifest: Manifest, job: Job, lines: Sequence[Mapping[str, Any]]) -> bool:
    """Whether the shards of a data set are those of a job; `lines` are the lines of its models."""
    samples = {line["model_id"]: line["samples"] for line in lines}
    expected = {
        block.shard for block in job.blocks() if any(samples[n.model_id] for n in block.names)
    }
    return expected == {shard.file for shard in manifest.shards}


def check(out: pathlib.Path, job: Job) -> bool:
    """Whether the data set of a job is complete in a folder; nothing is written.

    Raises:
      OtherSettingsError: the folder holds a data set that the job cannot continue or extend.
      ValueError: the folder holds something else.
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
                    f"--out {str(out)!r}: holds a complete data set without {missing}, made by "
                    "another command or an earlier version; give another folder, or remove it"
                )
            lines = read_report(out)
            there = _names(lines)
            _check_same(out, stated, there, job, "holds a complete data set made with")
            if there == list(job.names) and _is_manifest_of(manifest, job, lines):
                return True
    elif (
        any(not p.name.startswith(".") for p in out.iterdir())
        and not (
            out / MANIFEST  # another part may have written it meanwhile
        ).exists()
    ):
        raise ValueError(
            f"--out {str(out)!r}: not a data set, expected an empty or new folder or a data set"
        )
    unfinished = _unfinished(out)
    if unfinished:
        _check_same(out, unfinished[0], unfinished[1], job, "was started with")
    return False


def begin(out: pathlib.Path, job: Job) -> bool:
    """Creates the folder of a job or checks it like `check`, and writes the job's specification.

    Returns whether the data set is complete.
    """
    if check(out, job):
        tidy_up(out, job)
        return True
    unfinished = _unfinished(out)
    if unfinished is None or unfinished[1] != list(job.names):
        stated = {"job": job.statement, "choice": job.choice, "models": job.names}
        write_atomic(out / WORK / JOB, json.dumps(stated) + "\n")
    if not (out / MANIFEST).exists():
        save_manifest(out, Manifest(job.source, False, ()))
    return False


# --- Blocks -----------------------------------------------------------------------------------


def finish_block(out: pathlib.Path, block: Block) -> None:
    """Writes the shard of a block from the files of its models and marks the block as complete."""
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
    """The note of `finish_block`; None if the block is not complete or its shard is damaged."""
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
    """Reuses the results of earlier, smaller versions of a job in the folder.

    Unchanged blocks are marked as complete. The samples of models whose blocks have changed are
    written to the files of these models, as if they had just been rendered.

    Args:
      out: the folder.
      blocks: blocks of `job` that are to be completed.
      job: the job whose data set is written.
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
    """Names of shards that may exist in a folder, with the lines of their models.

    They are the shards of the complete data set and those of unfinished jobs.
    """
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
    """The records of a shard by model; empty if the shard does not fit the lines."""
    data: list[bytes] = []
    if any(line["samples"] for line in lines):
        try:
            data = read_shard(path)
            owners = [unpack(record)["model_id"] for record in data]
        except (ValueError, KeyError):  # missing or damaged: rendered again
            return []
        if owners != [line["model_id"] for line in lines for _ in range(line["samples"])]:
            return []
    result, start = [], 0
    for line in lines:
        result.append((line, data[start : start + line["samples"]]))
        start += line["samples"]
    return result


# --- Completion -------------------------------------------------------------------------------


def complete(
    out: pathlib.Path, job: Job, blocks: Sequence[Block]
) -> tuple[list[Mapping[str, Any]], bool]:
    """Completes the data set if all blocks are done.

    Returns:
      The lines of the models rendered so far, in order, and whether the data set is complete.

    Raises:
      RuntimeError: another command has started a different job in the folder.
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
    unfinished = _unfinished(out)
    if len(lines) < len(job.names):
        if unfinished is None and check(out, job):
            return read_report(out), True  # another part has completed the data set
        return lines, False
    if unfinished is None or unfinished[1] != list(job.names):
        if unfinished is None and check(out, job):
            return lines, True
        raise RuntimeError(
            f"--out {str(out)!r}: another command has started to render other models to it; the "
            "samples rendered so far are kept for that command"
        )
    text = "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines)
    # Characters that UTF-8 cannot encode are written as escapes of JSON.
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
    # Switches readers to the new state.
    save_manifest(out, manifest)
    tidy_up(out, job)
    return lines, True


def tidy_up(out: pathlib.Path, job: Job) -> None:
    """Removes files that are not part of the complete data set.

    Another process may do the same at the same time.
    """
    unfinished = _unfinished(out)
    if unfinished is None:
        with contextlib.suppress(OSError):
            (out / WORK).rmdir()  # left by a process that was killed at the very end
        return
    if unfinished[1] != list(job.names):
        return  # the data set is being extended
    kept = {shard.file for shard in load_manifest(out).shards}
    remove_temporaries(out)
    for path in out.iterdir():
        if _SHARD.fullmatch(path.name) and path.name not in kept:
            path.unlink(missing_ok=True)
    for path in (out / WORK).glob("*"):
        if path.name != JOB:
            path.unlink(missing_ok=True)
    (out / WORK / JOB).unlink(missing_ok=True)  # last, so that cleaning resumes after a kill
    try:
        (out / WORK).rmdir()
    except OSError:
        logging.info("%s is still used by another part of the job", out / WORK)
