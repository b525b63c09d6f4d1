"""0 A.D. and other games of the Pyrogenesis engine: a zip archive of actors, meshes and textures.

An actor (`art/actors/*.xml`) is a mesh, its textures, and other actors at the mesh's prop points:
a crane on a dock, a rider on a horse. Its groups each offer variants, of which the game takes one.
Meshes are the engine's own PMD files, which distributions ship in place of COLLADA; animations are
PSA files, whose first idle frame gives people and animals a natural pose. The archive is read in
place, see `archives.ZipFiles`.

Formats: https://trac.wildfiregames.com/wiki/PMD_File_Format and PSA_File_Format.
"""

import dataclasses
import functools
import hashlib
import os
import pathlib
import posixpath
import re
import struct
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from data_gen import catalogues, loading, meshes
from data_gen.catalogues import Entry, archives
from data_gen.meshes import Material, UnusableModelError

ACTORS = "art/actors/"

_MAX_XML_BYTES = 1 << 20
_MAX_MESH_BYTES = 32 << 20
_MAX_PARTS = 1000
_MAX_DEPTH = 6
_MAX_BONES = 255

# Folders of actors that are objects, and the category of each. The rest are pieces of others:
# heads, manes, roofs, crowns of trees.
_CATEGORIES = (
    (r"fauna/", "animal"),
    (r"flora/trees/", "tree"),
    (r"flora/|props/flora/", "plant"),
    (
        r"(units|structures|campaigns)/.*(ship|boat|trireme|quinq|bireme|penteconter|merchant)",
        "ship",
    ),
    (r"units/[^/]+/.*(operator|_infantry_|_[dh][0-9]?\.xml)", "person"),
    (r"units/[^/]+/.*(siege|catapult|ballista|onager|scorpio|wagon|chariot|cart_)", "machine"),
    (r"units/[^/]+/.*(cavalry|elephant|camel|horse|trader_h)", "rider"),
    (r"units/", "person"),
    (r"structures/|props/special/(palisade|greek_stoa)|campaigns/structures/", "building"),
    (r"props/special/eyecandy/", "thing"),
    (r"props/special/", "thing"),
    (r"props/units/shields/", "shield"),
    (r"props/units/helmets/", "helmet"),
    (r"props/units/(weapons|tools|standards|quivers|siege_artillery)/", "tool"),
    (r"geology/|props/geology/", "rock"),
)

# Names of actors that are no objects: pieces, marks on the ground, water, building sites.
_NO_OBJECTS = re.compile(
    r"decal|fndn|foundation|rubble|scaf|aura|marker|label|water|particle|smoke|fire|blood|fog"
    r"|delimitator|dirt|road|ground|path_|_top|_leaves|_leaf|crown|foliage|_props|_nature|_shields"
    r"|_tiles|_trees|_roof|_packed_|wings|temp/|/old/|sample|test|preloader|birds|butterfl|circle"
    r"|impact|shadow|field|helmets/props/|shields/props/|weapons/props/|_ammo|_r[0-9]?\.xml$|destruct_|structures/plot|rice_paddy|wall_gate_door|_dest|hero_star|projectile|_pivot|oar|rein|rope"
)

# Names of variants that an object at rest is not in.
_NOT_AT_REST = re.compile(
    r"damage|destr|death|dead|rubble|garrison|carry|gather|attack|build|promot|walk|run|capture"
    r"|despair|flee|ruin|approach|dance|salut|collaps",
    re.IGNORECASE,
)

_PLAYERS = (
    (0.07, 0.2, 0.6), (0.6, 0.07, 0.07), (0.34, 0.65, 0.12), (0.9, 0.85, 0.2), (0.1, 0.6, 0.6),
    (0.55, 0.3, 0.1), (0.8, 0.4, 0.05), (0.4, 0.1, 0.5),
)  # fmt: skip


# --- Meshes and animations --------------------------------------------------------------------


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


def read_pmd(data: bytes, max_faces: int = meshes.MAX_FACES) -> Mesh:
    """The arrays of a PMD file; what it announces is compared with its length.

    Raises:
      UnusableModelError: it is no such file, torn, or has too many faces.
    """
    place = 0

    def take(count: int, kind: str) -> np.ndarray:
        nonlocal place
        size = count * np.dtype(kind).itemsize
        if size > len(data) - place:
            raise UnusableModelError("not readable as PMD: it is torn")
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
    meshes.check_face_count(face_count, max_faces)
    faces = take(3 * face_count, "<u2").reshape(-1, 3).astype(np.int64)
    if face_count and faces.max() >= count:
        raise UnusableModelError("not readable as PMD: faces with vertices that do not exist")
    bone_count = int(take(1, "<u4")[0])
    if bone_count > _MAX_BONES:
        raise UnusableModelError(f"not readable as PMD: {bone_count} bones")
    rest = take(7 * bone_count, "<f4").reshape(-1, 7).astype(np.float64)
    props: dict[str, tuple[int, np.ndarray]] = {}
    for _ in range(min(int(take(1, "<u4")[0]), 10_000)):
        length = int(take(1, "<u4")[0])
        name = take(length, "u1").tobytes().decode("utf-8", "replace")
        state = take(7, "<f4").astype(np.float64)
        props[name.casefold()] = int(take(1, "u1")[0]), state
    if not all(np.isfinite(v).all() for v in (numbers, rest, *(s for _, s in props.values()))):
        raise UnusableModelError("the mesh has numbers that are not finite")
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
      UnusableModelError: it is no such file or torn.
    """
    if data[:4] != b"PSSA" or len(data) < 16:
        raise UnusableModelError("not readable as PSA: it does not begin with PSSA")
    (length,) = struct.unpack_from("<I", data, 12)
    place = 16 + length + 4
    if place + 8 > len(data):
        raise UnusableModelError("not readable as PSA: it is torn")
    bones, frames = struct.unpack_from("<II", data, place)
    if not frames or bones > _MAX_BONES or place + 8 + 28 * bones > len(data):
        raise UnusableModelError("not readable as PSA: it is torn")
    result = np.frombuffer(data, "<f4", 7 * bones, place + 8).reshape(-1, 7).astype(np.float64)
    if not np.isfinite(result).all():
        raise UnusableModelError("the animation has numbers that are not finite")
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
      mesh: any; one without bones stays as it is.
      frame: [B, 7] of `read_psa`; None or of another skeleton = the mesh's own pose.
    """
    at_rest = matrices(mesh.rest)
    if frame is None or len(frame) != len(mesh.rest) or not len(frame):
        return mesh.positions, mesh.normals, at_rest
    now = matrices(frame)
    # A bone number beyond the last means the object itself, which does not move.
    moves = np.concatenate([now @ np.linalg.inv(at_rest), np.eye(4)[None]])
    used = mesh.bones < len(moves)
    weights = np.where(used, mesh.weights, 0)
    loose = weights.sum(axis=1) < 1e-3
    blend = np.einsum("vk,vkij->vij", weights, moves[np.where(used, mesh.bones, len(now))])
    blend[loose] = np.eye(4)
    positions = np.einsum("vij,vj->vi", blend[:, :3, :3], mesh.positions) + blend[:, :3, 3]
    normals = np.einsum("vij,vj->vi", blend[:, :3, :3], mesh.normals)
    return positions, normals, now


# --- Actors -----------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Actor:
    """An actor with one variant of each group.

    Attributes:
      mesh: name below `art/meshes`, "" where it has none.
      texture: name below `art/textures/skins`, "" where it has none.
      material: name below `art/materials`.
      colour: of what the texture's alpha leaves open, where the material says so.
      animation: name below `art/animation` of an idle pose, or "".
      props: attach points and actors.
    """

    mesh: str
    texture: str
    material: str
    colour: tuple[float, float, float] | None
    animation: str
    props: tuple[tuple[str, str], ...]


def _parse(data: bytes, name: str) -> ElementTree.Element:
    if b"<!ENTITY" in data:
        raise UnusableModelError(f"{name!r}: XML entities are refused")
    try:
        return ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise UnusableModelError(f"{name!r} is not readable as XML: {error}"[:200]) from error


class Game:
    """The actors, meshes and textures of a game's archive.

    Args:
      files: of the archive.
    """

    def __init__(self, files: archives.ZipFiles) -> None:
        self._files = files
        self._xml: dict[str, ElementTree.Element] = {}
        self._modes: dict[str, str] = {}

    def read(self, name: str, limit: int) -> bytes:
        """A file of the archive; where it holds a converted file alone, that.

        Raises:
          UnusableModelError: there is none, or it is too large or damaged.
        """
        stem = posixpath.normpath(name)
        for candidate in (stem, f"{stem}.cached.dds", f"{stem}.cached.pmd", f"{stem}.cached.psa"):
            if candidate.startswith(("/", "../")):
                continue
            found = self._files.find(candidate)
            if found is not None:
                return self._files.read(found, limit)
        raise UnusableModelError(f"file {name!r} is missing")

    def xml(self, name: str) -> ElementTree.Element:
        """A file of the archive as XML, read once."""
        if name not in self._xml:
            self._xml[name] = _parse(self.read(name, _MAX_XML_BYTES), name)
        return self._xml[name]

    def _root(self, name: str) -> ElementTree.Element:
        """The element of an actor that has its groups: the best of several qualities."""
        root = self.xml(ACTORS + name)
        for _ in range(4):
            if root.tag != "qualitylevels":
                return root
            levels = root.findall("actor")
            inline = root.find("inline")
            best = levels[-1] if levels else root
            if "file" in best.attrib:
                root = self.xml(ACTORS + best.attrib["file"])
            elif inline is not None and "inline" in best.attrib:
                return inline
            else:
                return best
        return root

    def _groups(self, name: str) -> list[list[list[ElementTree.Element]]]:
        """Groups of an actor: the variants of each that an object at rest may be in.

        A variant is its own element after those of the files that it includes.
        """
        result = []
        for group in self._root(name).findall("group"):
            options = []
            for variant in group.findall("variant"):
                words = f"{variant.get('name', '')} {variant.get('file', '')}"
                options.append((variant, _frequency(variant), bool(_NOT_AT_REST.search(words))))
            chosen = [v for v, f, active in options if f > 0 and not active]
            # Where all are as rare, none is preferred.
            chosen = chosen or [v for v, _, active in options if not active][:1]
            if chosen:
                result.append([self._with_included(v) for v in chosen])
        return result

    def _with_included(self, variant: ElementTree.Element) -> list[ElementTree.Element]:
        chain = [variant]
        while "file" in chain[0].attrib and len(chain) < _MAX_DEPTH:
            try:
                chain.insert(0, self.xml("art/variants/" + chain[0].attrib["file"]))
            except UnusableModelError:
                break
        return chain

    def shapes(self, name: str, limit: int) -> int:
        """How many variants of an actor differ in their mesh, at most `limit`."""
        numbers = [
            len({e.findtext("mesh") for chain in group for e in chain} - {None})
            for group in self._groups(name)
        ]
        return max(1, min(limit, max(numbers, default=1)))

    def actor(self, name: str, variant: int) -> Actor:
        """An actor with the variants of a number.

        Raises:
          UnusableModelError: its file is missing or damaged.
        """
        mesh = texture = animation = ""
        colour = None
        props: dict[str, list[str]] = {}
        for group in self._groups(name):
            chain = group[variant % len(group)]
            for element in chain:
                mesh = (element.findtext("mesh") or mesh).strip()
                for each in element.iterfind("textures/texture"):
                    if each.get("name") == "baseTex":
                        texture = each.get("file", texture)
                idle = [
                    a.get("file", "")
                    for a in element.iterfind("animations/animation")
                    if a.get("name", "").casefold() == "idle"
                ]
                animation = idle[variant % len(idle)] if idle else animation
                words = (element.findtext("color") or "").split()
                if len(words) == 3 and all(w.isdecimal() for w in words):
                    red, green, blue = (min(int(w), 255) / 255 for w in words)
                    colour = (red, green, blue)
                here: dict[str, list[str]] = {}
                for each in element.iterfind("props/prop"):
                    point = each.get("attachpoint", "").casefold()
                    here.setdefault(point, []).append(each.get("actor", ""))
                props |= here  # a later group takes the place of an earlier one
        material = (self._root(name).findtext("material") or "").strip()
        pairs = tuple((point, each) for point, actors in props.items() for each in actors if each)
        return Actor(mesh, texture, material, colour, animation, pairs)

    def parts(
        self, name: str, variant: int, depth: int = 0
    ) -> Iterator[tuple[str, str, Actor, int]]:
        """Attach point, name, and depth of an actor and all actors that are attached to it.

        Those that come after an actor with a greater depth are attached to it. Missing ones are
        left out.
        """
        stack = [("", name, depth)]
        count = 0
        while stack:
            point, here, level = stack.pop()
            try:
                actor = self.actor(here, variant)
            except UnusableModelError:
                if not count:
                    raise
                continue
            count += 1
            if count > _MAX_PARTS or level > _MAX_DEPTH:
                raise UnusableModelError(f"more than {_MAX_PARTS} parts, or parts in each other")
            yield point, here, actor, level
            stack += [
                (p, a, level + 1)
                for p, a in reversed(actor.props)
                if p != "projectile" and not _is_mark(a)
            ]

    def mode(self, material: str) -> str:
        """What a texture's alpha means: "clear", "player", "colour" or "" = nothing."""
        if material not in self._modes:
            mode = ""
            try:
                for define in self.xml("art/materials/" + material).iterfind("define"):
                    mode = {
                        "USE_TRANSPARENT": "clear",
                        "USE_PLAYERCOLOR": "player",
                        "USE_OBJECTCOLOR": "colour",
                    }.get(define.get("name", ""), mode)
            except UnusableModelError:
                pass
            self._modes[material] = mode
        return self._modes[material]


def _frequency(variant: ElementTree.Element) -> int:
    text = variant.get("frequency", "0")
    return int(text) if re.fullmatch(r"[0-9]{1,9}", text) else 0


def _is_mark(actor: str) -> bool:
    """Whether a prop is a mark on the ground, water or an effect, which no mesh is made of."""
    return bool(re.search(r"decal|blood|aura|particle|smoke|fire|garrison_flag|water_", actor))


def _with_colour(texture: np.ndarray, colour: Sequence[float]) -> np.ndarray:
    """The texture opaque, a colour where its alpha is 0."""
    part = texture[..., 3:].astype(np.float64) / 255
    mixed = part * texture[..., :3] + (1 - part) * 255 * np.array(colour)
    opaque = np.full((*texture.shape[:2], 1), 255, np.uint8)
    return np.concatenate([mixed.round().astype(np.uint8), opaque], axis=2)


def assemble(
    game: Game,
    name: str,
    variant: int,
    side: int,
    max_faces: int,
    notes: loading.Notes,
) -> dict[str, Any]:
    """Arrays of an actor with all that is attached to it, for `meshes.build`.

    The axes are right-handed: x to the left, y up, z to the front.

    Raises:
      UnusableModelError: it has no mesh, one is missing or damaged, or it has too many faces.
    """
    digest = hashlib.sha256(f"{name}/{variant}".encode()).digest()
    player = _PLAYERS[digest[0] % len(_PLAYERS)]
    known: dict[tuple[str, str, Any], int] = {}
    materials: list[Material] = []
    pieces: dict[str, list[np.ndarray]] = {
        k: [] for k in ("vertices", "faces", "normals", "uv", "face_material")
    }
    # The chain of actors above the one at hand: their matrices, bones and meshes.
    above: list[tuple[np.ndarray, np.ndarray, Mesh | None]] = []
    total = offset = 0
    skipped = len(above) + _MAX_DEPTH + 1

    def material_of(actor: Actor) -> int:
        mode = game.mode(actor.material)
        colour = player if mode == "player" else actor.colour if mode == "colour" else None
        key = (actor.texture, mode, colour)
        if key not in known:
            known[key] = len(materials)
            texture = None
            if actor.texture:
                try:
                    data = game.read(f"art/textures/skins/{actor.texture}", loading.MAX_FILE_BYTES)
                    texture = loading.decode_texture(data, side)
                except ValueError as error:  # UnusableModelError is one
                    notes.add(f"texture {actor.texture!r}: {error}; grey stands in")
            if texture is not None and mode != "clear":
                texture = (
                    _with_colour(texture, colour or (1.0, 1.0, 1.0))
                    if colour
                    else np.dstack([texture[..., :3], np.full(texture.shape[:2], 255, np.uint8)])
                )
            grey = (0.6, 0.6, 0.6) if texture is None else (1.0, 1.0, 1.0)
            materials.append(Material(diffuse=grey, texture=texture, name=actor.texture))
        return known[key]

    for point, here, actor, level in game.parts(name, variant):
        if level > skipped:
            continue  # below one that is not attached
        skipped = _MAX_DEPTH + 1
        del above[level:]
        matrix = np.eye(4)
        if above:
            outer, bones, parent = above[-1]
            matrix = outer
            place = None if parent is None else parent.props.get(point.removeprefix("loaded-"))
            if place is None and point not in ("root", ""):
                skipped = level
                continue
            if place is not None:
                bone, state = place
                within = bones[bone] if bone < len(bones) else np.eye(4)
                matrix = outer @ within @ matrices(state)
        if not actor.mesh:
            above.append((matrix, np.zeros((0, 4, 4)), None))
            continue
        try:
            data = game.read(f"art/meshes/{actor.mesh}", _MAX_MESH_BYTES)
            mesh = read_pmd(data, max_faces)
        except UnusableModelError as error:
            if not level:
                raise
            notes.add(f"{here}: {error}; left out")
            skipped = level
            continue
        frame = None
        if actor.animation and len(mesh.rest):
            try:
                frame = read_psa(game.read(f"art/animation/{actor.animation}", _MAX_MESH_BYTES))
            except UnusableModelError as error:
                notes.add(f"{here}: {error}; it keeps its mesh's pose")
        positions, normals, bones = posed(mesh, frame)
        above.append((matrix, bones, mesh))
        total += len(mesh.faces)
        meshes.check_face_count(total, max_faces)
        mirror = np.array([-1.0, 1.0, 1.0])
        pieces["vertices"].append((positions @ matrix[:3, :3].T + matrix[:3, 3]) * mirror)
        pieces["normals"].append((normals @ matrix[:3, :3].T * mirror)[mesh.faces])
        pieces["faces"].append(mesh.faces + offset)
        pieces["uv"].append(mesh.uv[mesh.faces])
        pieces["face_material"].append(np.full(len(mesh.faces), material_of(actor)))
        offset += len(positions)
    if not total:
        raise UnusableModelError("the mesh is empty: the actor has no mesh")
    arrays: dict[str, Any] = {k: np.concatenate(v) for k, v in pieces.items()}
    return arrays | {"materials": loading.bounded(materials, notes)}


def cut_below(arrays: dict[str, Any], level: float = 0.0) -> dict[str, Any]:
    """Arrays for `meshes.build` without what lies below a height (y), such as foundations.

    Triangles that cross it are cut; one with two corners above becomes two.
    """
    corners = arrays["vertices"][arrays["faces"]]
    # Per corner: position, normal, texture coordinates.
    rows = np.concatenate([corners, arrays["normals"], arrays["uv"]], axis=2)
    above = rows[..., 1] >= level
    count = above.sum(axis=1)
    result, owners = [rows[count == 3]], [arrays["face_material"][count == 3]]
    for number in (1, 2):
        here = np.flatnonzero(count == number)
        # The corner that is alone on its side comes first.
        first = (above[here] == (number == 1)).argmax(axis=1)
        turn = (first[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(rows[here], turn[..., None], axis=1), 1, 0)
        ab, ac = (
            a + ((level - a[:, 1]) / (other[:, 1] - a[:, 1]))[:, None] * (other - a)
            for other in (b, c)
        )
        if number == 1:
            result.append(np.stack([a, ab, ac], axis=1))
            owners.append(arrays["face_material"][here])
        else:
            result += [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
            owners += [arrays["face_material"][here]] * 2
    whole = np.concatenate(result)
    if not len(whole):
        return arrays
    vertices, index = np.unique(whole[..., :3].reshape(-1, 3), axis=0, return_inverse=True)
    return arrays | {
        "vertices": vertices,
        "faces": index.reshape(-1, 3),
        "normals": whole[..., 3:6],
        "uv": whole[..., 6:],
        "face_material": np.concatenate(owners),
    }


# --- The catalogue ----------------------------------------------------------------------------


@functools.lru_cache(maxsize=2)
def _game(files: archives.ZipFiles) -> Game:
    return Game(files)


def _load(path: str, name: str, variant: int, category: str, model_id: str, max_faces: int) -> Any:
    try:
        files = archives.open_files(path)
    except (zipfile.BadZipFile, OSError, ValueError) as error:
        raise UnusableModelError(f"archive {path!r} cannot be read: {error}"[:200]) from error
    notes = loading.Notes()
    arrays = assemble(_game(files), name, variant, loading.TEXTURE_SIDE, max_faces, notes)
    if category == "building":  # its foundation is in the ground
        arrays = cut_below(arrays)
    model = meshes.build(
        **arrays,
        category=category,
        model_id=model_id,
        warnings=notes.lines,
        max_faces=max_faces,
    )
    return meshes.normalize(meshes.orient(model, "+y", "+z"))


def category_of(name: str) -> str:
    """Category of an actor by its file's name; "" where it is no object on its own."""
    if _NO_OBJECTS.search(name):
        return ""
    return next((c for pattern, c in _CATEGORIES if re.match(pattern, name)), "")


class PyrogenesisCatalogue:
    """Actors of a game's archive that are objects on their own.

    `units/romans/siege_ram.xml` is the model `units/romans/siege_ram`; of an actor that comes with
    several meshes, further ones are `...-2`, `...-3`. Actors made of the same meshes that differ
    in colours alone are taken twice, not more. Models whose main meshes have the same name but for
    a number or letter at its end share a split.

    Args:
      source: the archive, such as 0 A.D.'s `public.zip`, or a folder below which it lies.
      shapes: most models of one actor.
      colours: most models of the same meshes.
      fractions: of models for training, validation and test, see `catalogues.split_of`.
      max_faces: models with more are refused.

    Raises:
      ValueError: there is no such archive, it cannot be read or has no actors.
    """

    name = "pyrogenesis"

    def __init__(
        self,
        source: str | os.PathLike[str],
        *,
        shapes: int = 4,
        colours: int = 2,
        fractions: tuple[float, float, float] = catalogues.FRACTIONS,
        max_faces: int = meshes.MAX_FACES,
    ) -> None:
        path = pathlib.Path(source)
        if path.is_dir():
            path = next(iter(sorted(path.rglob("public.zip"))), path / "public.zip")
        if not path.is_file():
            raise ValueError(f"source {str(source)!r}: expected a game's public.zip")
        if shapes < 1 or colours < 1:
            raise ValueError(f"shapes, colours: got {shapes}, {colours}, expected 1 or more")
        try:
            files = archives.ZipFiles(path)
        except (zipfile.BadZipFile, OSError, ValueError) as error:
            raise ValueError(f"archive {str(path)!r} cannot be read: {error}") from error
        self.path, self._fractions, self._max_faces = path, fractions, max_faces
        self._models = list(self._choose(Game(files), files.names(), shapes, colours))
        if not self._models:
            raise ValueError(f"archive {str(path)!r}: it has no actors")

    @staticmethod
    def _choose(
        game: Game, names: list[str], shapes: int, colours: int
    ) -> Iterator[tuple[str, int, str, str]]:
        """Actor, variant, category and group of each model."""
        taken: dict[tuple[str, ...], set[tuple[str, ...]]] = {}
        for file in sorted(names):
            name = file.removeprefix(ACTORS)
            if name == file or not name.endswith(".xml") or not category_of(name):
                continue
            try:
                number = game.shapes(name, shapes)
                for variant in range(number):
                    parts = [a for _, _, a, _ in game.parts(name, variant) if a.mesh]
                    shape = tuple(a.mesh for a in parts)
                    looks = taken.setdefault(shape, set())
                    look = tuple(a.texture for a in parts)
                    if not parts or look in looks or len(looks) >= colours:
                        continue
                    looks.add(look)
                    yield name, variant, category_of(name), stem_of(shape[0])
            except UnusableModelError:
                # It is a model all the same, and its loader says what is wrong.
                yield name, 0, category_of(name), name

    def __len__(self) -> int:
        """Number of models."""
        return len(self._models)

    def entries(self) -> Iterator[Entry]:
        """The models, by the actors' names."""
        for name, variant, category, group in self._models:
            model_id = name.removesuffix(".xml") + (f"-{variant + 1}" if variant else "")
            yield Entry(
                model_id,
                category,
                catalogues.split_of(group, self._fractions),
                catalogues.loader(
                    _load, str(self.path), name, variant, category, model_id, self._max_faces
                ),
            )


def stem_of(mesh: str) -> str:
    """A mesh's name without ending, and without numbers and single letters at its end."""
    stem = posixpath.splitext(mesh)[0].casefold()
    return re.sub(r"([_-]?[0-9]+|[_-][a-z])+$", "", stem) or stem
