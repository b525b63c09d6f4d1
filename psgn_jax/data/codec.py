"""Encodes and decodes one record.

A record is a CRC-32 (4 bytes, little-endian) and a msgpack map, over which the CRC is computed. The
map has a key for each field of `psgn_jax.data.schema.Sample`. Nothing is pickled.

image      Lossless WebP, exact.
mask       Bits, deflated, exact.
depth      16-bit codes of the pixels with a depth, z = offset + scale * code. Exact for
           `DepthCodes`; otherwise the error is at most (max - min) / 131070.
points     Unsigned integers, sorted, as deflated differences, and the affine map [3, 4] to the
           project's frame. Exact for `QuantisedPoints`; otherwise the error is at most half a
           step, extent / 8190 on each axis at 12 bits.
occupancy  Bits, deflated, exact.
extra      Text, absent if empty.

Duplicate points are kept, their order is not. Other keys are ignored: older records have normals.
"""

import dataclasses
import io
import zlib
from collections.abc import Iterable, Mapping
from typing import Any

import msgpack
import numpy as np
from PIL import Image

from psgn_jax.data import schema
from psgn_jax.data.schema import Sample

DEFAULT_POINT_BITS = 12

# Half a percent more bytes than level 9, in a third of the time.
_DEFLATE_LEVEL = 5


@dataclasses.dataclass(frozen=True, eq=False)
class QuantisedPoints:
    """Points as integers: `point = matrix[:, :3] @ code + matrix[:, 3]` in the project's frame."""

    codes: np.ndarray  # uint8 or uint16 [M, 3]
    matrix: np.ndarray  # float64 [3, 4]

    def points(self, index: np.ndarray | slice = slice(None)) -> np.ndarray:
        """The points, or those at `index`: float32 [n, 3]."""
        matrix = self.matrix.astype(np.float32)
        codes = self.codes[index] if isinstance(index, slice) else self.codes.take(index, axis=0)
        return codes.astype(np.float32) @ matrix[:, :3].T + matrix[:, 3]


@dataclasses.dataclass(frozen=True, eq=False)
class DepthCodes:
    """Depth along the optical axis: `offset + scale * code` in the unit of the frame."""

    codes: np.ndarray  # uint16 [H, W]
    valid: np.ndarray  # bool [H, W], True where there is a depth
    scale: float
    offset: float

    def depth(self) -> np.ndarray:
        """float32 [H, W], 0 where there is no depth."""
        z = self.offset + self.scale * self.codes.astype(np.float64)
        return np.where(self.valid, z, 0.0).astype(np.float32)


def quantised(points: np.ndarray, bits: int = DEFAULT_POINT_BITS) -> QuantisedPoints:
    """Rounds points [M, 3] to 2**bits levels along each axis of their box, bits = 1 to 16."""
    points = np.asarray(points, np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    top = 2**bits - 1
    step = np.where(high > low, (high - low) / top, 1.0)
    dtype = np.uint8 if bits <= 8 else np.uint16
    codes = np.clip(np.rint((points - low) / step), 0, top).astype(dtype)
    return QuantisedPoints(codes, np.concatenate([np.diag(step), low[:, None]], axis=1))


def depth_codes_of(depth: np.ndarray) -> DepthCodes:
    """Rounds a depth map [H, W] (0 = none) to 65,536 levels between its minimum and maximum."""
    valid = depth > 0
    values = depth[valid].astype(np.float64)
    low, high = (values.min(), values.max()) if values.size else (0.0, 0.0)
    scale = (high - low) / 65535 if high > low else 1.0
    codes = np.where(valid, np.rint((depth - low) / scale), 0).astype(np.uint16)
    return DepthCodes(codes, valid, float(scale), float(low))


def _deflate(data: np.ndarray) -> bytes:
    return zlib.compress(np.ascontiguousarray(data).tobytes(), _DEFLATE_LEVEL)


def _inflate(data: Any, size: int, field: str) -> bytes:
    """Inflates to exactly `size` bytes, in bounded memory."""
    if not isinstance(data, bytes):
        raise ValueError(f"field {field!r} is {type(data).__name__}, expected bytes")
    stream = zlib.decompressobj()
    try:
        out = stream.decompress(data, size + 1)
    except zlib.error as error:
        raise ValueError(f"field {field!r} does not inflate: {error}") from None
    if len(out) != size or not stream.eof:
        raise ValueError(f"field {field!r} does not inflate to its {size} bytes")
    return out


def _integer(value: Any, low: int, high: int, what: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise ValueError(f"{what}: {repr(value)[:40]}, expected an integer from {low} to {high}")
    return value


def _byte_planes(values: np.ndarray, count: int) -> np.ndarray:
    """The bytes of unsigned integers, all lowest bytes first, which deflates well."""
    return np.stack([(values >> (8 * i)) & 255 for i in range(count)]).astype(np.uint8)


def _from_byte_planes(data: bytes, count: int, dtype: Any) -> np.ndarray:
    planes = np.frombuffer(data, np.uint8).reshape(count, -1)
    values = planes[0].astype(dtype)
    for i in range(1, count):
        values |= planes[i].astype(dtype) << dtype(8 * i)
    return values


def _encode_image(image: np.ndarray) -> dict[str, Any]:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "WEBP", lossless=True, quality=25, method=2)
    return {"size": list(image.shape[:2]), "webp": buffer.getvalue()}


def _decode_image(stored: Mapping[str, Any], size: tuple[int, int]) -> np.ndarray:
    try:
        picture = Image.open(io.BytesIO(stored["image"]["webp"]), formats=("WEBP",))
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise ValueError(f"image is far larger than {size[::-1]}, as the record says") from None
    # The header decides how much memory decoding takes, so it is checked first.
    if picture.size != size[::-1] or picture.mode != "RGB":
        raise ValueError(
            f"image is {picture.mode} {picture.size}, the record says RGB {size[::-1]}"
        )
    return np.asarray(picture)


def _decode_bits(data: Any, shape: tuple[int, ...], field: str) -> np.ndarray:
    count = int(np.prod(shape))
    packed = np.frombuffer(_inflate(data, -(-count // 8), field), np.uint8)
    return np.unpackbits(packed, count=count).reshape(shape).view(np.bool_)


def _encode_depth(depth: DepthCodes, mask: np.ndarray) -> dict[str, Any]:
    values = depth.codes[depth.valid].astype(np.int32)
    steps = np.diff(values, prepend=np.int32(0)).astype(np.uint16)  # modulo 2**16
    signed = steps.view(np.int16)
    zigzag = ((signed << 1) ^ (signed >> 15)).view(np.uint16)  # small magnitudes get small codes
    return {
        "scale": depth.scale,
        "offset": depth.offset,
        # None: the pixels with a depth are those of the mask, as usual.
        "valid": None if np.array_equal(depth.valid, mask) else _deflate(np.packbits(depth.valid)),
        "steps": _deflate(_byte_planes(zigzag, 2)),
    }


def _decode_depth(stored: Mapping[str, Any], mask: np.ndarray) -> DepthCodes:
    field = stored["depth"]
    scale, offset = float(field["scale"]), float(field["offset"])
    valid = mask if field["valid"] is None else _decode_bits(field["valid"], mask.shape, "depth")
    count = int(valid.sum())
    codes = np.zeros(mask.shape, np.uint16)
    if count:
        zigzag = _from_byte_planes(_inflate(field["steps"], 2 * count, "depth"), 2, np.uint16)
        steps = (zigzag >> np.uint16(1)) ^ (~(zigzag & np.uint16(1)) + np.uint16(1))
        values = np.cumsum(steps, dtype=np.uint16)
        codes[valid] = values
        ends = [offset + scale * float(code) for code in (values.min(), values.max())]
        if not (-abs(scale) <= min(ends) and max(ends) <= schema.MAX_COORDINATE):
            most = f"{schema.MAX_COORDINATE:g}"
            raise ValueError(f"depth from {ends[0]:g} to {ends[1]:g}, expected 0 to {most}")
    return DepthCodes(codes, valid, scale, offset)


def _point_keys(codes: np.ndarray) -> np.ndarray:
    bits = np.uint64(8 * codes.dtype.itemsize)
    wide = codes.astype(np.uint64)
    return (wide[:, 0] << (2 * bits)) | (wide[:, 1] << bits) | wide[:, 2]


def _encode_points(points: QuantisedPoints) -> dict[str, Any]:
    keys = np.sort(_point_keys(points.codes))
    steps = np.diff(keys, prepend=np.uint64(0))
    planes = max(1, -(-int(steps.max()).bit_length() // 8))
    return {
        "count": len(keys),
        "bits": 8 * points.codes.dtype.itemsize,
        "matrix": points.matrix.astype("<f8").tobytes(),
        "planes": planes,
        "steps": _deflate(_byte_planes(steps, planes)),
    }


def _decode_points(stored: Mapping[str, Any]) -> QuantisedPoints:
    field = stored["points"]
    count = _integer(field["count"], 1, schema.MAX_POINTS, "number of points")
    bits, planes = field["bits"], _integer(field["planes"], 1, 6, "planes of the points")
    if bits not in (8, 16) or isinstance(bits, float):
        raise ValueError(f"points of {repr(bits)[:40]} bits, expected 8 or 16")
    small = bits == 8 and planes <= 3
    dtype: Any = np.uint32 if small else np.uint64
    steps = _from_byte_planes(_inflate(field["steps"], planes * count, "points"), planes, dtype)
    keys = np.cumsum(steps, dtype=dtype)
    # A little-endian key consists of the codes of z, y and x, and zeros.
    fields = keys.astype("<u4" if small else "<u8").view(np.uint8 if bits == 8 else "<u2")
    codes = np.ascontiguousarray(fields.reshape(count, -1)[:, 2::-1])
    matrix = np.frombuffer(field["matrix"], "<f8").reshape(3, 4).astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        reach = matrix[:, :3] * float(codes.max())
        ends = matrix[:, 3] + [np.minimum(reach, 0).sum(axis=1), np.maximum(reach, 0).sum(axis=1)]
        farthest = np.abs(ends).max()
    if not farthest <= schema.MAX_COORDINATE:  # NaN, too
        most = f"{schema.MAX_COORDINATE:g}"
        raise ValueError(f"points up to {farthest:g}, expected coordinates up to {most}")
    return QuantisedPoints(codes, matrix)


def encode(
    sample: Sample,
    *,
    points: QuantisedPoints | None = None,
    depth: DepthCodes | None = None,
    point_bits: int = DEFAULT_POINT_BITS,
) -> bytes:
    """The bytes of a sample's record; ValueError if `schema.validate` refuses the sample.

    `points` and `depth`, if given, are the codes of the sample's fields and are stored exactly.
    Otherwise the points are quantised to `point_bits`.
    """
    try:
        schema.validate(sample)
    except ValueError as error:
        raise ValueError(f"model {sample.model_id!r}, view {sample.view}: {error}") from None
    points = points or quantised(sample.points, point_bits)
    stored: dict[str, Any] = {
        "image": _encode_image(sample.image),
        "mask": _deflate(np.packbits(sample.mask)),
        "points": _encode_points(points),
        "intrinsics": sample.intrinsics.astype("<f4").tobytes(),
        "extrinsics": sample.extrinsics.astype("<f4").tobytes(),
        "category": sample.category,
        "model_id": sample.model_id,
        "view": int(sample.view),
        "source": sample.source,
    }
    if sample.extra:
        stored["extra"] = sample.extra
    if sample.depth is not None:
        stored["depth"] = _encode_depth(depth or depth_codes_of(sample.depth), sample.mask)
    if sample.occupancy is not None:
        stored["occupancy"] = _deflate(np.packbits(sample.occupancy))
    body = msgpack.packb(stored)
    return zlib.crc32(body).to_bytes(4, "little") + body


def unpack(data: bytes) -> dict[str, Any]:
    """The msgpack map of a record; ValueError if the checksum does not match or it is no map."""
    body = data[4:]
    if len(data) < 5 or zlib.crc32(body) != int.from_bytes(data[:4], "little"):
        raise ValueError("its checksum does not match")
    stored = msgpack.unpackb(body)
    if not isinstance(stored, dict):
        raise ValueError(f"it contains {type(stored).__name__}, expected a map of fields")
    return stored


def decode_stored(data: bytes, fields: Iterable[str] = schema.FIELDS) -> Any:
    """A `Sample` whose points are `QuantisedPoints` and whose depth is `DepthCodes`.

    Arrays that are missing or not in `fields` are None; `depth` includes `mask`. The other fields
    are always present. ValueError if a field is invalid.
    """
    stored = unpack(data)
    present = {field for field in fields if field in stored}
    values: dict[str, Any] = dict.fromkeys(schema.FIELDS)
    try:
        height, width = stored["image"]["size"]
        size = (
            _integer(height, 1, schema.MAX_IMAGE_SIDE, "height of the image"),
            _integer(width, 1, schema.MAX_IMAGE_SIDE, "width of the image"),
        )
        if "image" in present:
            values["image"] = _decode_image(stored, size)
        if present & {"mask", "depth"}:
            values["mask"] = _decode_bits(stored["mask"], size, "mask")
        if "depth" in present:
            values["depth"] = _decode_depth(stored, values["mask"])
        if "points" in present:
            values["points"] = _decode_points(stored)
        if "occupancy" in present:
            shape = (schema.OCCUPANCY_SIZE,) * 3
            values["occupancy"] = _decode_bits(stored["occupancy"], shape, "occupancy")
        values |= {name: stored[name] for name in ("category", "model_id", "view", "source")}
        values["intrinsics"] = np.frombuffer(stored["intrinsics"], "<f4").reshape(3, 3)
        values["extrinsics"] = np.frombuffer(stored["extrinsics"], "<f4").reshape(3, 4)
        decoded = Sample(**values, extra=stored.get("extra", ""))
        schema.check_camera(decoded.intrinsics, decoded.extrinsics)
        schema.check_labels(decoded)
    except (KeyError, TypeError, OSError, EOFError, SyntaxError, OverflowError) as error:
        # The checksum matches, so another program wrote the record.
        raise ValueError(f"a field is not as expected: {type(error).__name__} {error}") from error
    return decoded


def decode(data: bytes) -> Sample:
    """The sample of a record; ValueError if it is damaged or has no image, mask or points."""
    stored = decode_stored(data)
    if stored.image is None or stored.mask is None or stored.points is None:
        raise ValueError("a field is missing, expected image, mask and points")
    depth = stored.depth and stored.depth.depth()
    return dataclasses.replace(stored, depth=depth, points=stored.points.points())
