"""Trees of arrays as dicts of named leaves, as in checkpoints and files of weights."""

import hashlib
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from flax import traverse_util


def named_leaves(tree: Any) -> dict[str, Any]:
    """Leaves by dotted path, such as `{"params.head.kernel": ...}`."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(tree)
    return {jax.tree_util.keystr(path, simple=True, separator="."): leaf for path, leaf in leaves}


def from_named_leaves(template: Any, leaves: Mapping[str, np.ndarray]) -> Any:
    """A tree with these leaves and the structure of `template`, a tree of arrays or shapes.

    ValueError if a leaf is missing, not in `template`, or of another shape or dtype.
    """
    wanted = named_leaves(template)
    if different := sorted(wanted.keys() ^ leaves.keys()):
        where = "missing" if different[0] in wanted else "not expected"
        raise ValueError(f"leaf {different[0]} is {where} ({len(different)} leaves differ)")
    for name, want in wanted.items():
        have, expected = (f"{x.dtype}{list(x.shape)}" for x in (leaves[name], want))
        if have != expected:
            raise ValueError(f"leaf {name} is {have}, expected {expected}")
    return jax.tree.unflatten(jax.tree.structure(template), [leaves[name] for name in wanted])


def checksum(leaves: Mapping[str, Any], head: bytes = b"") -> str:
    """SHA-256 of `head` and the names, dtypes, shapes and values of the leaves."""
    digest = hashlib.sha256(head)
    for name, leaf in sorted(leaves.items()):
        array = np.ascontiguousarray(leaf)
        digest.update(f"{name} {array.dtype} {array.shape}\n".encode())
        digest.update(array.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def params_from_named_leaves(leaves: Mapping[str, np.ndarray], *, averaged: bool = True) -> Any:
    """The parameters of a checkpoint as a nested dict; if `averaged`, the averages, if any."""
    averaged = averaged and any(name.startswith("ema.") for name in leaves)
    section = "ema." if averaged else "params."
    chosen = {n.removeprefix(section): x for n, x in leaves.items() if n.startswith(section)}
    return traverse_util.unflatten_dict(chosen, sep=".")
