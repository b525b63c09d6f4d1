"""Actors of Pyrogenesis: meshes with textures and attached actors.

An actor (`art/actors/*.xml`) consists of a mesh, its textures, and other actors attached to the
prop points of the mesh, such as a crane on a dock or a rider on a horse. It has groups of variants;
the game chooses one variant of each group.
"""

import dataclasses
import hashlib
import posixpath
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from data_gen.mesh import Material, UnusableModelError, check_face_count
from data_gen.readers import archives
from data_gen.readers.files import MAX_FILE_BYTES
from data_gen.readers.notes import Notes
from data_gen.readers.pmd import Mesh, matrices, posed, read_pmd, read_psa
from data_gen.readers.textures import bounded, decode_texture

ACTORS = "art/actors/"

_MAX_XML_BYTES = 1 << 20

_MAX_MESH_BYTES = 32 << 20

_MAX_PARTS = 1000

_MAX_DEPTH = 6

# Names of variants that show damage or activity; objects are shown intact and at rest.
_NOT_AT_REST = re.compile(
    r"damage|destr|death|dead|rubble|garrison|carry|gather|attack|build|promot|walk|run|capture"
    r"|despair|flee|ruin|approach|dance|salut|collaps",
    re.IGNORECASE,
)

_PLAYERS = (
    (0.07, 0.2, 0.6), (0.6, 0.07, 0.07), (0.34, 0.65, 0.12), (0.9, 0.85, 0.2), (0.1, 0.6, 0.6),
    (0.55, 0.3, 0.1), (0.8, 0.4, 0.05), (0.4, 0.1, 0.5),
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Actor:
    """An actor with one variant of each group.

    Attributes:
      mesh: name below `art/meshes`, "" if there is none.
      texture: name below `art/textures/skins`, "" if there is none.
      material: name below `art/materials`.
      colour: colour of the transparent texels, if the material uses one.
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
    """The actors, meshes and textures in the archive of a game.

    Args:
      files: files of the archive.
    """

    def __init__(self, files: archives.ZipFiles) -> None:
        self._files = files
        self._xml: dict[str, ElementTree.Element] = {}
        self._modes: dict[str, str] = {}

    def read(self, name: str, limit: int) -> bytes:
        """A file of the archive, or its converted form if only that exists.

        Raises:
          UnusableModelError: the file is missing, too large or damaged.
        """
        stem = posixpath.normpath(name)
        for candidate in (stem, f"{stem}.cached.dds", f"{stem}.cached.pmd", f"{stem}.cached.psa"):
            if candidate.startswith(("/", "../")):
                continue
            stored = self._files.find(candidate)
            if stored is not None:
                return self._files.read(stored, limit)
        raise UnusableModelError(f"file {name!r} is missing")

    def xml(self, name: str) -> ElementTree.Element:
        """A file of the archive as XML; it is read only once."""
        if name not in self._xml:
            self._xml[name] = _parse(self.read(name, _MAX_XML_BYTES), name)
        return self._xml[name]

    def _root(self, name: str) -> ElementTree.Element:
        """The element of an actor that contains its groups, at the best quality level."""
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
        """For each group of an actor, the variants that are possible for an object at rest.

        A variant is a list of XML elements: those of the files that it includes, then its own.
        """
        result = []
        for group in self._root(name).findall("group"):
            options = []
            for variant in group.findall("variant"):
                words = f"{variant.get('name', '')} {variant.get('file', '')}"
                options.append((variant, _frequency(variant), bool(_NOT_AT_REST.search(words))))
            chosen = [v for v, f, active in options if f > 0 and not active]
            # If none of the variants at rest has a positive frequency, the first of them is used.
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
        """The number of variants of an actor with different meshes, at most `limit`."""
        numbers = [
            len({e.findtext("mesh") for chain in group for e in chain} - {None})
            for group in self._groups(name)
        ]
        return max(1, min(limit, max(numbers, default=1)))

    def actor(self, name: str, variant: int) -> Actor:
        """An actor with the variants that `variant` selects.

        Raises:
          UnusableModelError: the file is missing or damaged.
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
                props |= here  # a later group overrides an earlier one
        material = (self._root(name).findtext("material") or "").strip()
        pairs = tuple((point, each) for point, actors in props.items() for each in actors if each)
        return Actor(mesh, texture, material, colour, animation, pairs)

    def parts(
        self, name: str, variant: int, depth: int = 0
    ) -> Iterator[tuple[str, str, Actor, int]]:
        """An actor and all actors attached to it, depth first: attach point, name, actor, depth.

        Missing actors are left out.
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
                raise UnusableModelError(
                    f"more than the limit of {_MAX_PARTS} parts, or an actor attached to itself"
                )
            yield point, here, actor, level
            stack += [
                (p, a, level + 1)
                for p, a in reversed(actor.props)
                if p != "projectile" and not _is_mark(a)
            ]

    def mode(self, material: str) -> str:
        """The meaning of a texture's alpha: "clear", "player", "colour" or "" = none."""
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
    """Whether a prop is a marking on the ground, water or an effect, which are left out."""
    return bool(re.search(r"decal|blood|aura|particle|smoke|fire|garrison_flag|water_", actor))


def _with_colour(texture: np.ndarray, colour: Sequence[float]) -> np.ndarray:
    """The texture blended with a colour by its alpha, as an opaque texture."""
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
    notes: Notes,
) -> dict[str, Any]:
    """Arrays of an actor and all attached actors, for `mesh.build_model`.

    Deliberately one function: it walks the tree of parts with the state of all parents.

    The axes are right-handed: x to the left, y up, z to the front.

    Raises:
      UnusableModelError: there is no mesh, a mesh is missing or damaged, or there are too many
        faces.
    """
    digest = hashlib.sha256(f"{name}/{variant}".encode()).digest()
    player = _PLAYERS[digest[0] % len(_PLAYERS)]
    known: dict[tuple[str, str, Any], int] = {}
    materials: list[Material] = []
    pieces: dict[str, list[np.ndarray]] = {
        k: [] for k in ("vertices", "faces", "normals", "uv", "face_material")
    }
    # The parents of the current actor: their matrices, bones and meshes.
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
                    data = game.read(f"art/textures/skins/{actor.texture}", MAX_FILE_BYTES)
                    texture = decode_texture(data, side)
                except ValueError as error:  # UnusableModelError is one
                    notes.add(f"texture {actor.texture!r}: {error}; grey is used instead")
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
            continue  # its parent was left out
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
                notes.add(f"{here}: {error}; the pose of the mesh is used")
        positions, normals, bones = posed(mesh, frame)
        above.append((matrix, bones, mesh))
        total += len(mesh.faces)
        check_face_count(total, max_faces)
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
    return arrays | {"materials": bounded(materials, notes)}


def cut_below_ground(arrays: dict[str, Any]) -> dict[str, Any]:
    """Arrays for `mesh.build_model` without the surface below y = 0, such as foundations.

    Triangles that cross y = 0 are cut; a triangle with two corners above it becomes two.
    """
    corners = arrays["vertices"][arrays["faces"]]
    # Per corner: position, normal, texture coordinates.
    rows = np.concatenate([corners, arrays["normals"], arrays["uv"]], axis=2)
    above = rows[..., 1] >= 0
    count = above.sum(axis=1)
    result, owners = [rows[count == 3]], [arrays["face_material"][count == 3]]
    for number in (1, 2):
        here = np.flatnonzero(count == number)
        # The corner that is alone on its side is put first.
        first = (above[here] == (number == 1)).argmax(axis=1)
        turn = (first[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(rows[here], turn[..., None], axis=1), 1, 0)
        ab, ac = (
            a + ((0.0 - a[:, 1]) / (other[:, 1] - a[:, 1]))[:, None] * (other - a)
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
