"""Reader of COLLADA files (1.4 and 1.5), with the XML parser of Python.

We do not use pycollada. It leaves out a whole geometry that contains a strip of lines, and an
instance with one missing material; it ignores the offset and the stride of accessors in silence.
"""

import contextlib
import io
import posixpath
import re
from collections.abc import Iterator
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from data_gen.mesh import GREY, Material, UnusableModelError
from data_gen.polygons import fan, strip, with_holes
from data_gen.readers.model_files import DamagedError, ZipFiles, check_size, numbers
from data_gen.readers.parts import Look, Part, picked, placed, rgba
from data_gen.readers.textures import MISSING_TEXTURE, NO_COORDINATES, Assets, with_alpha

MAX_XML_BYTES = 64 << 20

_MAX_NODES = 100_000  # a node may have several instances

# Turn the axis that points up into +y, by its name.
_TURNS = {
    "Z_UP": ((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)),
    "X_UP": ((0, -1, 0, 0), (1, 0, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)),
}

_SHADERS = ("phong", "blinn", "lambert", "constant")

_WRAPS = {"MIRROR": "mirror", "CLAMP": "clamp", "BORDER": "clamp", "NONE": "clamp"}

_PLACED = ("repeatU", "repeatV", "offsetU", "offsetV", "rotateUV", "rotateFrame")  # of Maya


def parsed_xml(data: bytes) -> Element:
    """The root of an XML file, whose tags are without namespaces: some files have none."""
    check_size("the XML file", len(data), MAX_XML_BYTES)
    if b"<!ENTITY" in data.replace(b"\0", b""):  # UTF-16 has zeros
        raise UnusableModelError("XML entities are refused")
    try:
        root = ElementTree.fromstring(data.lstrip())
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise DamagedError(f"XML, {error}") from error
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    return root


def read_collada(data: bytes, assets: Assets) -> list[Part]:
    """The geometries of the scene of a COLLADA file, turned to +y up."""
    root = parsed_xml(data)
    if root.tag != "COLLADA":
        raise DamagedError(f"it is XML with <{root.tag[:40]}>")
    parts = _Document(root, assets).parts()
    if not parts and assets.warnings:
        raise UnusableModelError(f"the mesh is empty: {assets.warnings[0]}")
    return parts


def read_zae(data: bytes, assets: Assets) -> list[Part]:
    """The geometries of a zip archive that contains a COLLADA file and its textures."""
    assets.files = ZipFiles(io.BytesIO(data))
    name = next((n for n in assets.files.names if n.lower().endswith(".dae")), None)
    if name is None:
        raise DamagedError("it contains no .dae file")
    assets.base = posixpath.dirname(name)
    return read_collada(assets.files.read(name), assets)


def _numbers(element: Element | None, count: int = 0) -> np.ndarray:
    """The numbers in an element: at least `count`, of which we take the first; 0 = all."""
    text, tag = ("", "") if element is None else (element.text or "", element.tag)
    values = numbers(text.split(), where=f" in <{tag}>")
    if len(values) < count:
        raise DamagedError(f"{len(values)} numbers, expected {count}")
    return values[:count] if count else values


def _integer(element: Element, name: str, default: int) -> int:
    """An attribute that is a number from 0."""
    text = (element.get(name) or "").strip() or str(default)
    if not text.isdecimal():
        raise DamagedError(f"{text[:20]!r}, expected a number")
    return int(text)


def _id(url: str | None) -> str:
    """The identifier at a URL of the same file."""
    return (url or "").strip().removeprefix("#")


def _transform(node: Element) -> np.ndarray:
    """The product [4, 4] of the transforms of a node."""
    result = np.eye(4)
    for element in node:
        matrix = np.eye(4)
        if element.tag == "matrix":
            matrix = _numbers(element, 16).reshape(4, 4)
        elif element.tag == "translate":
            matrix[:3, 3] = _numbers(element, 3)
        elif element.tag == "scale":
            matrix[range(3), range(3)] = _numbers(element, 3)
        elif element.tag == "rotate":
            *axis, degrees = _numbers(element, 4)
            length = np.linalg.norm(axis)
            x, y, z = np.array(axis) / (length or 1)
            cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            angle = np.radians(degrees)
            turn = np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
            matrix[:3, :3] += turn
        elif element.tag in ("skew", "lookat"):
            raise DamagedError(f"<{element.tag}>")
        result = result @ matrix
    return result


class _Document:
    """The elements of a file by their identifiers, and what was read of them."""

    def __init__(self, root: Element, assets: Assets) -> None:
        self.root, self.assets = root, assets
        self.ids = {(e.tag, name): e for e in root.iter() if (name := e.get("id"))}
        self.looks: dict[Element, tuple[Look, str]] = {}
        self.numbers: dict[Element, np.ndarray] = {}

    def find(self, url: str | None, *tags: str) -> Element:
        """The element with one of these tags at a URL of this file."""
        found = [e for tag in tags if (e := self.ids.get((tag, _id(url)))) is not None]
        if not found:
            raise DamagedError(f"{tags[0]} {url!r} is not in the file")
        return found[0]

    def parts(self) -> list[Part]:
        """All geometries of the scene, in its axes."""
        axis = (self.root.findtext("asset/up_axis") or "").strip().upper()
        turn = np.array(_TURNS.get(axis, np.eye(4)), np.float64)
        instance = self.root.find("scene/instance_visual_scene")
        url = "" if instance is None else _id(instance.get("url"))
        scenes = self.root.findall("library_visual_scenes/visual_scene")
        if len(scenes) > 1:
            self.assets.warn("scenes other than the default one not read", len(scenes) - 1)
        scene = self.ids.get(("visual_scene", url))
        if scene is None:
            scene = scenes[0] if scenes else None
            used = "all geometries are" if scene is None else "the first is"
            self.assets.warn(f"no scene, {used} read")
        if self.root.find("library_animations/animation") is not None:
            self.assets.warn("animations not read, the pose of the nodes is taken")
        roots = self.root.findall("library_geometries") if scene is None else [scene]
        stack = [(root, turn) for root in roots]
        parts: list[Part] = []
        visited = 0
        while stack:
            node, matrix = stack.pop()
            visited += 1
            if visited > _MAX_NODES:
                what = f"more than {_MAX_NODES} nodes, or nodes that contain themselves"
                raise UnusableModelError(what)
            with self.left_out("nodes", node):
                matrix = matrix @ _transform(node)
                for child in reversed(node):
                    with self.left_out("parts of the scene", child):
                        if child.tag == "node":
                            stack.append((child, matrix))
                        elif child.tag == "instance_node":
                            stack.append((self.find(child.get("url"), "node"), matrix))
                        elif child.tag == "instance_geometry":
                            geometry = self.find(child.get("url"), "geometry")
                            parts += self.instance(geometry, child, matrix)
                        elif child.tag == "instance_controller":
                            controller = self.find(child.get("url"), "controller")
                            geometry, shape = self.controlled(controller)
                            # Joints move a skin, the node in which it is does not.
                            here = matrix if shape is None else turn @ shape
                            parts += self.instance(geometry, child, here)
                        elif child.tag == "geometry" and node.tag == "library_geometries":
                            parts += self.instance(child, child, matrix)
        return parts

    @contextlib.contextmanager
    def left_out(self, what: str, element: Element) -> Iterator[None]:
        """Leaves out, with a warning, what is damaged."""
        try:
            yield
        except DamagedError as error:
            name = element.get("id") or element.get("url") or element.get("name") or element.tag
            self.assets.warn(f"{what} not readable, left out", f"{name} ({error})")

    def controlled(self, controller: Element) -> tuple[Element, np.ndarray | None]:
        """The geometry of a controller, and the matrix of a skin in bind pose."""
        shape = None
        for _ in range(3):  # a skin of a morph of a geometry
            kind = controller.find("skin")
            if kind is not None:
                given = kind.find("bind_shape_matrix")
                shape = np.eye(4) if given is None else _numbers(given, 16).reshape(4, 4)
                self.assets.warn("skins are read in bind pose", controller.get("id"))
            elif (kind := controller.find("morph")) is not None:
                self.assets.warn("morph targets not read, base shapes are", controller.get("id"))
            else:
                raise DamagedError("a controller without skin and morph")
            controller = self.find(kind.get("source"), "geometry", "controller")
            if controller.tag == "geometry":
                return controller, shape
        raise DamagedError("controllers of controllers")

    def instance(self, geometry: Element, element: Element, matrix: np.ndarray) -> list[Part]:
        """The polygons of a geometry with the materials of its instance."""
        mesh = geometry.find("mesh")
        if mesh is None:
            kinds = [child.tag for child in geometry if child.tag not in ("asset", "extra")]
            raise DamagedError(f"geometry {geometry.get('id')!r} is a {(kinds or ['void'])[0]}")
        instances = element.iterfind("bind_material/technique_common/instance_material")
        bound = {instance.get("symbol"): instance for instance in instances}
        parts = []
        for primitive in mesh:
            if primitive.tag in ("lines", "linestrips"):
                self.assets.warn("lines and points not read", geometry.get("id"))
            elif primitive.tag in ("triangles", "polylist", "polygons", "tristrips", "trifans"):
                with self.left_out("parts of geometries", geometry):
                    parts.append(self.part(primitive, bound, matrix))
        return parts

    def part(
        self, primitive: Element, bound: dict[str | None, Element], matrix: np.ndarray
    ) -> Part:
        """The polygons of a primitive."""
        inputs: dict[tuple[str, str], tuple[int, Element]] = {}
        for element in primitive.iterfind("input"):
            offset = _integer(element, "offset", 0)
            semantic, number = element.get("semantic") or "", element.get("set") or "0"
            if semantic == "VERTEX":
                for inner in self.find(element.get("source"), "vertices").iterfind("input"):
                    source = self.find(inner.get("source"), "source")
                    inputs[inner.get("semantic") or "", inner.get("set") or "0"] = offset, source
            elif semantic in ("NORMAL", "TEXCOORD", "COLOR"):
                inputs[semantic, number] = offset, self.find(element.get("source"), "source")
        if ("POSITION", "0") not in inputs:
            raise DamagedError("no positions")
        stride = 1 + max(_integer(e, "offset", 0) for e in primitive.iterfind("input"))
        at, source = inputs["POSITION", "0"]
        positions = self.source(source, 3)[:, :3]
        counts, rows = _polygons(primitive, stride, at, positions)
        self.assets.add_faces(int(np.maximum(counts - 2, 0).sum()))

        def of_corners(semantic: str, number: str, least: int) -> np.ndarray | None:
            at, source = inputs.get((semantic, number), (0, None))
            return None if source is None else picked(self.source(source, least), rows[:, at])

        look, chosen = self.bound_look(primitive.get("material"), bound)
        sets = [number for semantic, number in inputs if semantic == "TEXCOORD"]
        first = min(sets, key=lambda number: (len(number), number), default="0")
        if chosen and chosen not in sets:
            self.assets.warn("missing sets of texture coordinates, others are used", chosen)
        uv = of_corners("TEXCOORD", chosen if chosen in sets else first, 2)
        if uv is None and look is not None and look.material.texture is not None:
            self.assets.warn(NO_COORDINATES, primitive.get("material"))
        colours = of_corners("COLOR", min((n for s, n in inputs if s == "COLOR"), default="0"), 3)
        normals = of_corners("NORMAL", "0", 3)
        part = Part(
            positions, counts, rows[:, at], (look,),
            uv=None if uv is None else uv[:, :2],
            normals=None if normals is None else normals[:, :3],
            colours=None if colours is None else rgba(colours, self.assets),
        )  # fmt: skip
        return placed(part, matrix[None])

    def source(self, element: Element, least: int) -> np.ndarray:
        """The numbers [n, c] of a source, at least `least` of them in a row."""
        accessor = element.find("technique_common/accessor")
        accessor = Element("accessor") if accessor is None else accessor
        array = element.find("float_array")
        if array is None:
            array = self.find(accessor.get("source"), "float_array")
        if array not in self.numbers:
            self.numbers[array] = _numbers(array)
        values = self.numbers[array]
        stride, skipped = _integer(accessor, "stride", 1), _integer(accessor, "offset", 0)
        rest = max(len(values) - skipped, 0)
        count = _integer(accessor, "count", rest // (stride or 1))
        if not stride or skipped + count * stride > len(values):
            raise DamagedError(f"{len(values)} numbers, expected {count} x {stride}")
        params = accessor.findall("param")
        named = [k for k, param in enumerate(params[:stride]) if param.get("name")]
        table = values[skipped : skipped + count * stride].reshape(count, stride)
        if stride < least:
            raise DamagedError(f"{stride} numbers, expected {least}")
        return table[:, named] if len(named) >= least else table

    def bound_look(
        self, symbol: str | None, bound: dict[str | None, Element]
    ) -> tuple[Look | None, str]:
        """The look of a symbol, and the set of texture coordinates that it uses, or ""."""
        if symbol is None:
            return None, ""
        instance = bound.get(symbol)
        try:
            element = self.find(symbol if instance is None else instance.get("target"), "material")
            look, name = self.looks[element] = self.looks.get(element) or self.look(element)
        except DamagedError as error:
            self.assets.warn("materials missing, grey is used", f"{symbol!r} ({error})")
            return None, ""
        inputs = () if instance is None else instance.iterfind("bind_vertex_input")
        sets = [e.get("input_set") or "0" for e in inputs if e.get("semantic") == name]
        return look, (sets or [""])[0]

    def look(self, element: Element) -> tuple[Look, str]:
        """A material, and the name of the texture coordinates of its texture."""
        instance = element.find("instance_effect")
        effect = self.find(None if instance is None else instance.get("url"), "effect")
        profile = effect.find("profile_COMMON")
        technique = None if profile is None else profile.find("technique")
        if profile is None or technique is None:
            raise DamagedError("an effect without profile_COMMON")
        shader = next((e for e in technique if e.tag in _SHADERS), None)
        if shader is None:
            raise DamagedError(f"an effect with none of {', '.join(_SHADERS)}")
        parents = (effect, profile, technique)
        params = {e.get("sid"): e for parent in parents for e in parent.iterfind("newparam")}
        title = element.get("id")
        if instance is not None and instance.find("setparam") is not None:
            self.assets.warn("parameters that a material sets not read", title)

        def values(name: str, default: tuple[float, ...] = ()) -> tuple[float, ...]:
            """The numbers of a colour or of a factor, if there are as many as in the default."""
            value = shader.find(name)
            if value is None or not len(value) or value[0].tag == "texture":
                return default
            inner = value[0]
            if inner.tag == "param" and len(params.get(inner.get("ref"), ())):
                inner = params[inner.get("ref")][0]
            found = _numbers(inner).tolist()
            return tuple(found) if len(found) >= len(default) else default

        def rgb(name: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
            red, green, blue, *_ = np.clip(values(name, default), 0, 1).tolist()
            return red, green, blue

        source = "emission" if shader.tag == "constant" else "diffuse"
        texture, wraps, name = self.texture(shader.find(f"{source}/texture"), params)
        diffuse = rgb(source, GREY if texture is None else (1.0, 1.0, 1.0))
        if source == "diffuse" and max(rgb("emission", (0.0, 0.0, 0.0))) > 0.02:
            self.assets.warn("emission not read", title)
        glossy = shader.tag in ("phong", "blinn")
        specular = rgb("specular", (0.0, 0.0, 0.0)) if glossy else (0.0, 0.0, 0.0)
        shininess = values("shininess", (20.0,))[0]
        shininess = min(max(shininess, 1.0), 1000.0) if shininess >= 1 else 20.0  # some: 0 to 1

        transparent, opacity = shader.find("transparent"), 1.0
        mode = ("" if transparent is None else transparent.get("opaque")) or "A_ONE"
        factor = values("transparency", (1.0,))[0]
        picture, *_ = self.texture(shader.find("transparent/texture"), params)
        if picture is not None:
            level = picture[..., 3] if mode[0] == "A" else picture[..., :3].mean(axis=2)
            level = (255 - factor * level if mode.endswith("ZERO") else factor * level).clip(0, 255)
            texture = with_alpha(texture, level.round().astype(np.uint8))
        elif transparent is not None or shader.find("transparency") is not None:
            clear = [*values("transparent"), 1.0, 1.0, 1.0, 1.0]
            level = factor * (clear[3] if mode[0] == "A" else sum(clear[:3]) / 3)
            if level == 0 and transparent is not None and transparent.get("opaque") is None:
                # Several writers mean that nothing is transparent.
                self.assets.warn("transparency 0, opaque is used", title)
                level = 1.0
            opacity = min(max(1 - level if mode.endswith("ZERO") else level, 0.0), 1.0)
        elif texture is not None and (texture[..., 3] < 255).any():
            self.assets.warn("alpha of textures without <transparent> not used", title)
            texture = with_alpha(texture, np.full(texture.shape[:2], 255, np.uint8))
        title = element.get("name") or title or ""
        material = Material(diffuse, specular, shininess, opacity, texture, title)
        return Look(material, wraps=wraps), name

    def texture(
        self, element: Element | None, params: dict[str | None, Element]
    ) -> tuple[np.ndarray | None, tuple[str, str], str]:
        """A <texture>, how it wraps, and the name of its coordinates; None if it is missing."""
        wraps = ["repeat", "repeat"]
        if element is None:
            return None, ("repeat", "repeat"), ""
        image = element.get("texture") or ""
        sampler = params[image].find("sampler2D") if image in params else None
        if sampler is not None:
            wraps = [_WRAPS.get((sampler.findtext(f"wrap_{k}") or "").strip(), "repeat")
                     for k in "st"]  # fmt: skip
            instance = sampler.find("instance_image")
            surface = params.get((sampler.findtext("source") or "").strip())
            if instance is not None:
                image = instance.get("url") or ""
            elif surface is not None:
                image = surface.findtext("surface/init_from") or ""
        for inner in element.iter():
            if inner.tag in _PLACED and _numbers(inner, 1)[0] != inner.tag.startswith("repeat"):
                self.assets.warn("placement of textures not read", inner.tag)
        found = self.ids.get(("image", _id(image)), Element("image"))
        file = (found.findtext("init_from/ref") or found.findtext("init_from") or "").strip()
        picture = self.assets.texture(re.sub(r"^file:/*", "", file)) if file else None
        if not file:
            self.assets.warn(MISSING_TEXTURE, repr(image))
        return picture, (wraps[0], wraps[1]), element.get("texcoord") or ""


def _polygons(
    primitive: Element, stride: int, at: int, positions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The number of corners of each polygon, and the indices [C, stride] of all corners."""

    def rows(element: Element) -> np.ndarray:
        values = _numbers(element)
        if len(values) % stride or (values != np.rint(values)).any():
            raise DamagedError(f"{len(values)} indices, expected {stride} whole ones a corner")
        return values.astype(np.int64).reshape(-1, stride)

    blocks = [rows(element) for element in primitive.findall("p")]
    empty = np.zeros((0, stride), np.int64)
    if primitive.tag in ("tristrips", "trifans"):
        order = strip if primitive.tag == "tristrips" else fan
        blocks = [block[order(len(block)).ravel()] for block in blocks]
    if primitive.tag == "polygons":
        for element in primitive.iterfind("ph"):
            loops = [rows(child) for child in element if child.tag in ("p", "h")]
            corners = np.concatenate([empty, *loops])
            where = np.clip(corners[:, at], 0, len(positions) - 1)
            blocks.append(corners[with_holes(positions[where], [len(loop) for loop in loops])])
        sizes = np.array([len(block) for block in blocks], np.int64)
        return sizes, np.concatenate([empty, *blocks])
    corners = np.concatenate([empty, *blocks])
    if primitive.tag == "polylist":
        counts = _numbers(primitive.find("vcount")).astype(np.int64)
        if (counts < 0).any() or counts.sum() != len(corners):
            raise DamagedError(f"{len(corners)} corners, expected {counts.sum()}")
        return counts, corners
    if len(corners) % 3:
        raise DamagedError(f"{len(corners)} corners of triangles")
    return np.full(len(corners) // 3, 3), corners
