"""Meshes (PMD) and animations (PSA) of the Pyrogenesis engine.

Formats: https://trac.wildfiregames.com/wiki/PMD_File_Format and PSA_File_Format.
"""

import dataclasses
import struct

import numpy as np

from data_gen.mesh import MAX_FACES, UnusableModelError, check_face_count

_MAX_BONES = 255


@dataclasses.dataclass(frozen=True, eq=False)
class Mesh:
    """A PMD file.

    Attributes:
      positions: [V, 3] in the engine's left-handed axes: x right, y up, z to the front.
      normals: [V, 3].
      uv: [V, 2] of the first set.
      bones, weights: [V, 4] of each vertex; bone 255 = none.
      faces: [F, 3].
      rest: [B, 7] of the bones: translation, quaternion (x, y, z, w).
      props: prop points by name: bone (255 = none) and [7] relative to it.
    """

    positions: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    bones: np.ndarray
    weights: np.ndarray
    faces: np.ndarray
    rest: np.ndarray
    props: dict[str, tuple[int, np.ndarray]]


def read_pmd(data: bytes, max_faces: int = MAX_FACES) -> Mesh:
    """The arrays of a PMD file. The counts in the file are compared with its length.

    Raises:
      UnusableModelError: this is not a PMD file, it is truncated, or it has too many faces.
    """
    place = 0

    def take(count: int, kind: str) -> np.ndarray:
        nonlocal place
        size = count * np.dtype(kind).itemsize
        if size > len(data) - place:
            raise UnusableModelError("not readable as PMD: the file is truncated")
        values = np.frombuffer(data, kind, count, place)
        place += size
        return values

    if data[:4] != b"PSMD" or len(data) < 16:
        raise UnusableModelError("not readable as PMD: it does not begin with PSMD")
    place = 4
    version, _, count = (int(v) for v in take(3, "<u4"))
    if version not in (3, 4):
        raise UnusableModelError(f"not readable as PMD: version {version}, expected 3 or 4")
    sets = int(take(1, "<u4")[0]) if version == 4 else 1
    if not 1 <= sets <= 8:
        raise UnusableModelError(
            f"not readable as PMD: {sets} texture coordinates, expected 1 to 8"
        )
    vertex = f"({6 + 2 * sets},)<f4, (4,)u1, (4,)<f4"
    vertices = take(count, vertex)
    numbers = vertices["f0"].astype(np.float64)
    face_count = int(take(1, "<u4")[0])
    check_face_count(face_count, max_faces)
    faces = take(3 * face_count, "<u2").reshape(-1, 3).astype(np.int64)
    if face_count and faces.max() >= count:
        raise UnusableModelError("not readable as PMD: faces with vertices that are missing")
    bone_count = int(take(1, "<u4")[0])
    if bone_count > _MAX_BONES:
        raise UnusableModelError(f"not readable as PMD: {bone_count} bones, more than the limit")
    rest = take(7 * bone_count, "<f4").reshape(-1, 7).astype(np.float64)
    props: dict[str, tuple[int, np.ndarray]] = {}
    for _ in range(min(int(take(1, "<u4")[0]), 10_000)):
        length = int(take(1, "<u4")[0])
        name = take(length, "u1").tobytes().decode("utf-8", "replace")
        state = take(7, "<f4").astype(np.float64)
        props[name.casefold()] = int(take(1, "u1")[0]), state
    if not all(np.isfinite(v).all() for v in (numbers, rest, *(s for _, s in props.values()))):
        raise UnusableModelError("the mesh contains values that are not finite")
    return Mesh(
        positions=numbers[:, :3],
        normals=numbers[:, 3:6],
        uv=numbers[:, 6:8],
        bones=vertices["f1"].astype(np.int64),
        weights=np.nan_to_num(vertices["f2"].astype(np.float64)),
        faces=faces,
        rest=rest,
        props=props,
    )


def read_psa(data: bytes) -> np.ndarray:
    """The first frame of a PSA file: [B, 7] as `Mesh.rest`.

    Raises:
      UnusableModelError: this is not a PSA file, or it is truncated.
    """
    if data[:4] != b"PSSA" or len(data) < 16:
        raise UnusableModelError("not readable as PSA: it does not begin with PSSA")
    (length,) = struct.unpack_from("<I", data, 12)
    place = 16 + length + 4
    if place + 8 > len(data):
        raise UnusableModelError("not readable as PSA: the file is truncated")
    bones, frames = struct.unpack_from("<II", data, place)
    if not frames or bones > _MAX_BONES or place + 8 + 28 * bones > len(data):
        raise UnusableModelError("not readable as PSA: the file is truncated")
    result = np.frombuffer(data, "<f4", 7 * bones, place + 8).reshape(-1, 7).astype(np.float64)
    if not np.isfinite(result).all():
        raise UnusableModelError("the animation contains values that are not finite")
    return result


def matrices(states: np.ndarray) -> np.ndarray:
    """Translations and quaternions [..., 7] as matrices [..., 4, 4]."""
    move, quaternion = states[..., :3], states[..., 3:]
    length = np.linalg.norm(quaternion, axis=-1, keepdims=True)
    identity = np.array([0.0, 0.0, 0.0, 1.0])
    quaternion = np.where(length > 1e-6, quaternion / np.maximum(length, 1e-6), identity)
    x, y, z, w = np.moveaxis(quaternion, -1, 0)
    result = np.zeros((*states.shape[:-1], 4, 4))
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    result[..., :3, :3] = np.moveaxis(np.array(rows), (0, 1), (-2, -1))
    result[..., :3, 3] = move
    result[..., 3, 3] = 1
    return result


def posed(mesh: Mesh, frame: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, normals, and matrices [B, 4, 4] of the bones, in the pose of an animation.

    Args:
      mesh: the mesh; without bones it is unchanged.
      frame: result [B, 7] of `read_psa`. With None, or the frame of another skeleton, the mesh
        keeps its own pose.
    """
    at_rest = matrices(mesh.rest)
    if frame is None or len(frame) != len(mesh.rest) or not len(frame):
        return mesh.positions, mesh.normals, at_rest
    now = matrices(frame)
    # A bone number above the last one denotes the object itself, which does not move.
    moves = np.concatenate([now @ np.linalg.inv(at_rest), np.eye(4)[None]])
    used = mesh.bones < len(moves)
    weights = np.where(used, mesh.weights, 0)
    loose = weights.sum(axis=1) < 1e-3
    blend = np.einsum("vk,vkij->vij", weights, moves[np.where(used, mesh.bones, len(now))])
    blend[loose] = np.eye(4)
    positions = np.einsum("vij,vj->vi", blend[:, :3, :3], mesh.positions) + blend[:, :3, 3]
    normals = np.einsum("vij,vj->vi", blend[:, :3, :3], mesh.normals)
    return positions, normals, now
