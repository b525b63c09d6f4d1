"""The result of rendering a model, as bytes and as a file."""

import hashlib
import json
import pathlib
from collections.abc import Mapping
from typing import Any

import msgpack

from data_gen.catalogues.entry import Entry
from psgn_jax.files import write_atomic
from psgn_jax.untrusted import parse_json


def work_path(folder: pathlib.Path, model_id: str) -> pathlib.Path:
    """The file of a model's samples until its shard is written."""
    name = hashlib.sha256(model_id.encode("utf-8", "surrogatepass")).hexdigest()[:24]
    return folder / f"{name}.model"


def failure(entry: Entry, status: str, reason: str) -> dict[str, Any]:
    """The line of `models.jsonl` for a model without samples."""
    return {
        "model_id": entry.model_id,
        "category": entry.category,
        "split": entry.split,
        "status": status,
        "reason": reason,
        "samples": 0,
    }


def pack_result(line: Mapping[str, Any], data: list[bytes]) -> bytes:
    """The line and the records of a model as bytes."""
    packed: bytes = msgpack.packb({"line": json.dumps(line), "records": data})
    return packed


def write_result(folder: pathlib.Path, model_id: str, content: bytes) -> None:
    """Writes the bytes of `pack_result` to a file atomically."""
    write_atomic(work_path(folder, model_id), content, sync=False)


def read_result(path: pathlib.Path) -> tuple[dict[str, Any], list[bytes]]:
    """Reads the file of `write_result`: the line and the records of a model.

    Raises:
      ValueError: the file is damaged.
    """
    try:
        content = msgpack.unpackb(path.read_bytes())
        return parse_json(content["line"]), list(content["records"])
    except Exception as error:
        # msgpack raises many types of errors.
        raise ValueError(f"{path}: damaged ({error})") from error
