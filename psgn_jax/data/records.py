"""What the data stage (`data_gen`) needs to write data sets, under one name.

The package itself imports from `data.codec`, `data.manifest`, `data.dataset` and `files`.
"""

from psgn_jax.data.codec import DEFAULT_POINT_BITS, decode, encode, unpack
from psgn_jax.data.dataset import RecordReader, ShardWriter, read_shard, shard_name, write_dataset
from psgn_jax.data.manifest import MANIFEST, Manifest, Shard, load_manifest, save_manifest
from psgn_jax.data.schema import RecordError
from psgn_jax.files import write_atomic

__all__ = [
    "DEFAULT_POINT_BITS",
    "MANIFEST",
    "Manifest",
    "RecordError",
    "RecordReader",
    "Shard",
    "ShardWriter",
    "decode",
    "encode",
    "load_manifest",
    "read_shard",
    "save_manifest",
    "shard_name",
    "unpack",
    "write_atomic",
    "write_dataset",
]
