"""Reader of COLLADA files (1.4 and 1.5), with the XML parser of Python.

We do not use pycollada. It drops a whole geometry because of a strip of lines, and an instance
because of a missing material, and it ignores the offset and the stride of accessors.
"""

import contextlib
import io
import posixpath
import re
import urllib.parse
from collections.abc import Iterator
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from data_gen.mesh import GREY, UnusableModelError, unit_vectors
from data_gen.polygons import fan, strip, with_holes
from data_gen.readers.model_files import DamagedError, ZipFiles, check_size, numbers
from data_gen.readers.parts import Look, Part, material, picked, rgba, transformed
from data_gen.readers.textures import MISSING_TEXTURE, NO_COORDINATES, Assets

MAX_XML_BYTES = 64 << 20

# Rotations of the upward axis to +y, by the name of the axis.
_TURNS = {
    "Z_UP": ((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)),
    "X_UP": ((0, -1, 0, 0), (1, 0, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)),
}

_SHADERS = ("phong", "blinn", "lambert", "constant")
_WRAPS = {"MIRROR": "mirror", "CLAMP": "clamp", "BORDER": "clamp", "NONE": "clamp"}
_SHOWN = ("node", "geometry", "instance_node", "instance_geometry", "instance_controller")
_BLACK = (0.0, 0.0, 0.0)
_PLACED = ("repeatU", "repeatV", "offsetU", "offsetV", "rotateUV", "rotateFrame")  # of Maya


def parsed_xml(data: bytes, assets: Assets) -> Element:
    """The root of an XML file. We remove namespaces from tags, because some files have none."""
    check_size("the XML file", len(data), MAX_XML_BYTES)
    assets.budget.charge(made=32 * len(data))
    text = data.replace(b"\0", b"")  # UTF-16 has zeros
    if b"<!ENTITY" in text or b"<!ATTLIST" in text:
        raise UnusableModelError("XML entities and default attributes are refused")
    try:
        root = ElementTree.fromstring(data.lstrip())
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise DamagedError(f"XML, {error}") from error
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    return root


def read_collada(data: bytes, assets: Assets) -> list[Part]:
    """The geometries of the scene of a COLLADA file, turned to +y up."""
    root = parsed_xml(data, assets)
    if root.tag != "COLLADA":
        raise DamagedError(f"it is XML with <{root.tag[:40]}>")
    parts = _Document(root, assets).parts()
    if not parts and assets.warnings:
        raise UnusableModelError(f"the mesh is empty: {assets.warnings[0]}")
    return parts


def read_zae(data: bytes, assets: Assets) -> list[Part]:
    """The geometries of a zip archive of COLLADA files and their textures.

    A manifest names the file that we read; without one, it is the first.
    """
    assets.files = ZipFiles(io.BytesIO(data))
    names = [n for n in assets.files.names if n.lower().endswith(".dae") and "/." not in f"/{n}"]
    if (manifest := assets.files.find("manifest.xml")) is not None:
        text = parsed_xml(assets.files.read(manifest), assets).text or ""
        path = posixpath.normpath(urllib.parse.unquote(text.partition("#")[0].strip()))
        names = [found] if (found := assets.files.find(path.lstrip("/"))) else names
    if not names:
        raise DamagedError("it contains no .dae file")
    if len(names) > 1:
        assets.warn("no manifest names the document, the first one is read", repr(names[0]))
    assets.base, assets.name = posixpath.split(name := names[0])
    return read_collada(assets.files.read(name), assets)


def _numbers(element: Element | None, count: int = 0) -> np.ndarray:
    """The first `count` numbers in an element; 0 = all."""
    text, tag = ("", "") if element is None else (element.text or "", element.tag)
    values = numbers(text.split(), where=f" in <{tag}>")
    if len(values) < count:
        raise DamagedError(f"{len(values)} numbers, expected {count}")
    return values[:count] if count else values


def _integer(element: Element, name: str, default: int) -> int:
    """An attribute with a whole number from 0."""
    text = (element.get(name) or "").strip() or str(default)
    if not text.isdecimal():
        raise DamagedError(f"{text[:20]!r}, expected a number")
    return int(text)


def _transform(node: Element) -> np.ndarray:
    """The product [4, 4] of a node's transforms."""
    result = np.eye(4)
    for element in node:
        matrix = np.eye(4)
        match element.tag:
            case "matrix":
                matrix = _numbers(element, 16).reshape(4, 4)
            case "translate":
                matrix[:3, 3] = _numbers(element, 3)
            case "scale":
                matrix[range(3), range(3)] = _numbers(element, 3)
            case "rotate":
                *axis, degrees = _numbers(element, 4)
                vector = np.radians(degrees) * unit_vectors(np.array(axis))
                matrix[:3, :3] = Rotation.from_rotvec(vector).as_matrix()
            case "lookat":
                eye, interest, up = _numbers(element, 9).reshape(3, 3)
                back = unit_vectors(eye - interest)
                right = unit_vectors(np.cross(up, back))
                matrix[:3] = np.stack([right, np.cross(back, right), back, eye], axis=1)
            case "skew":  # as in RenderMan: it turns the first axis toward the second
                degrees, *axes = _numbers(element, 7)
                one, two = unit_vectors(np.reshape(axes, (2, 3)))
                angle, between = np.radians(degrees), np.arccos(np.clip(one @ two, -1, 1))
                across = unit_vectors(one - (one @ two) * two)
                turned = np.sin(angle) / np.sin(between - angle) / np.sin(between)
                matrix[:3, :3] += turned * np.outer(two, across)
        result = result @ matrix
    return result


class _Document:
    """The elements of a file by tag and identifier."""

    def __init__(self, root: Element, assets: Assets) -> None:
        self.root, self.assets = root, assets
        self.ids = {(e.tag, name): e for e in root.iter() if (name := e.get("id"))}
        self.looks: dict[Element, tuple[Look, str]] = {}
        self.numbers: dict[Element, np.ndarray] = {}
        self.costs: dict[Element, int] = {}

    def visit(self, element: Element) -> None:
        """Charges what it costs to read an element with all that it contains, once more."""
        if element not in self.costs:
            self.costs[element] = sum(64 + 16 * len(e.text or "") for e in element.iter())
        self.assets.budget.charge(visits=1, made=self.costs[element])

    def find(self, url: str | None, *tags: str) -> Element:
        """The element with one of the `tags` and a URL such as `#cube` or `this_file.dae#cube`."""
        text = (url or "").strip()
        file, _, name = urllib.parse.unquote(text).rpartition("#")
        own = posixpath.basename(file).casefold() in ("", self.assets.name.casefold())
        names = (text, text.removeprefix("#"), name if own else "")
        found = [e for n in names for tag in tags if (e := self.ids.get((tag, n))) is not None]
        if not found:
            raise DamagedError(f"{tags[0]} {url!r} is not in the file")
        return found[0]

    def parts(self) -> list[Part]:
        """All geometries of the scene, turned to +y up."""
        roots = scenes = self.root.findall("library_visual_scenes/visual_scene")
        if len(scenes) > 1:
            self.assets.warn("scenes other than the default one not read", len(scenes) - 1)
        instance = self.root.find("scene/instance_visual_scene")
        url = None if instance is None else instance.get("url")
        try:
            roots = [self.find(url, "visual_scene")]
        except DamagedError:
            self.assets.warn("no scene, the first one or all geometries are read", url or "")
        places = [*roots[:1], *self.root.iterfind("library_visual_scenes"), self.root]
        axes = [(e.findtext("asset/up_axis") or "").strip().upper() for e in places]
        turn = np.array(_TURNS.get(next(filter(None, axes), ""), np.eye(4)), np.float64)
        if self.root.find("library_animations/animation") is not None:
            self.assets.warn("animations not read, the pose of the nodes is taken")
        stack = [(e, turn) for e in roots[:1] or self.root.findall("library_geometries")]
        parts: list[Part] = []
        while stack:
            element, matrix = stack.pop()
            self.visit(element)
            with self.left_out(element):
                match element.tag:
                    case "node" | "visual_scene" | "library_geometries":
                        matrix = matrix @ _transform(element)
                        shown = [e for e in reversed(element) if e.tag in _SHOWN]
                        self.assets.budget.charge(visits=len(shown))
                        stack += [(e, matrix) for e in shown]
                    case "instance_node":
                        stack.append((self.find(element.get("url"), "node"), matrix))
                    case "geometry":
                        parts += self.instance(element, element, matrix)
                    case "instance_geometry":
                        geometry = self.find(element.get("url"), "geometry")
                        parts += self.instance(geometry, element, matrix)
                    case _:
                        controller = self.find(element.get("url"), "controller")
                        geometry, shape = self.controlled(controller)
                        # Joints move a skin; its node does not.
                        matrix = matrix if shape is None else turn @ shape
                        parts += self.instance(geometry, element, matrix)
        return parts

    @contextlib.contextmanager
    def left_out(self, element: Element) -> Iterator[None]:
        """Turns a `DamagedError` into a warning."""
        try:
            yield
        except DamagedError as error:
            name = element.get("id") or element.get("url") or element.get("name") or element.tag
            self.assets.warn("parts not readable, left out", f"{name} ({error})")

    def controlled(self, controller: Element) -> tuple[Element, np.ndarray | None]:
        """A controller's geometry, and the matrix of its bind pose; None for a morph."""
        shape = None
        for _ in range(3):  # a skin may contain a morph, a morph a geometry
            kind = controller.find("skin")
            if kind is not None:
                given = kind.find("bind_shape_matrix")
                shape = np.eye(4) if given is None else _numbers(given, 16).reshape(4, 4)
                self.assets.warn("skins are read in bind pose", controller.get("id"))
            elif (kind := controller.find("morph")) is not None:
                self.assets.warn("morph targets not read, base shapes are", controller.get("id"))
            else:
                raise DamagedError("a controller without <skin> and <morph>")
            controller = self.find(kind.get("source"), "geometry", "controller")
            if controller.tag == "geometry":
                return controller, shape
        raise DamagedError("controllers of controllers")

    def instance(self, geometry: Element, element: Element, matrix: np.ndarray) -> list[Part]:
        self.visit(geometry)
        mesh = geometry.find("mesh")
        if mesh is None:
            raise DamagedError(f"geometry {geometry.get('id')!r} has no <mesh>")
        instances = element.iterfind("bind_material/technique_common/instance_material")
        bound = {instance.get("symbol"): instance for instance in instances}
        parts = []
        for primitive in mesh:
            if primitive.tag in ("lines", "linestrips"):
                self.assets.warn("lines and points not read", geometry.get("id"))
            elif primitive.tag in ("triangles", "polylist", "polygons", "tristrips", "trifans"):
                self.assets.budget.charge(visits=1)
                with self.left_out(geometry):
                    parts.append(transformed(self.part(primitive, bound), matrix[None]))
        return parts

    def part(self, primitive: Element, bound: dict[str | None, Element]) -> Part:
        """The polygons of a primitive; `bound` has its materials by their symbols."""
        inputs: dict[tuple[str, str], tuple[int, str | None]] = {}
        stride = 1
        for element in primitive.iterfind("input"):
            offset, inner = _integer(element, "offset", 0), [element]
            stride = max(stride, offset + 1)
            if element.get("semantic") == "VERTEX":
                inner = self.find(element.get("source"), "vertices").findall("input")
                self.assets.budget.charge(made=64 * len(inner))
            for each in inner:
                key = each.get("semantic") or "", each.get("set") or "0"
                inputs[key] = offset, each.get("source")
        if ("POSITION", "0") not in inputs:
            raise DamagedError("no positions")
        at, url = inputs["POSITION", "0"]
        positions = self.source(url, 2)[:, :3]
        if positions.shape[1] == 2:
            positions = np.pad(positions, ((0, 0), (0, 1)))
        counts, rows = _polygons(primitive, stride, at, positions, self.assets)
        self.assets.budget.charge(faces=np.maximum(counts - 2, 0).sum())

        def of_corners(semantic: str, number: str, width: int) -> np.ndarray | None:
            if (semantic, number) not in inputs:
                return None
            at, url = inputs[semantic, number]
            columns = 4 if semantic == "COLOR" else width
            return picked(self.source(url, width)[:, :columns], rows[:, at], self.assets)

        look, chosen = self.bound_look(primitive.get("material"), bound)
        sets = [number for semantic, number in inputs if semantic == "TEXCOORD"]
        first = min(sets, key=lambda number: (len(number), number), default="0")
        if chosen and chosen not in sets:
            self.assets.warn("missing sets of texture coordinates, others are used", chosen)
        uv = of_corners("TEXCOORD", chosen if chosen in sets else first, 2)
        if uv is None and look is not None and look.material.texture is not None:
            self.assets.warn(NO_COORDINATES, primitive.get("material"))
        colours = of_corners("COLOR", min((n for s, n in inputs if s == "COLOR"), default="0"), 3)
        return Part(
            positions, counts, rows[:, at], (look,), uv=uv, normals=of_corners("NORMAL", "0", 3),
            colours=None if colours is None else rgba(colours, self.assets),
        )  # fmt: skip

    def source(self, url: str | None, least: int) -> np.ndarray:
        """The numbers [n, c] of a source, with c at least `least`."""
        element = self.find(url, "source")
        accessor = element.find("technique_common/accessor")
        accessor = Element("accessor") if accessor is None else accessor
        array = element.find("float_array")
        if array is None:
            array = self.find(accessor.get("source"), "float_array")
        if array not in self.numbers:
            self.assets.budget.charge(made=16 * len(array.text or ""))
            self.numbers[array] = _numbers(array)
        values = self.numbers[array][_integer(accessor, "offset", 0) :]
        stride = _integer(accessor, "stride", 1)
        count = _integer(accessor, "count", len(values) // (stride or 1))
        if count * stride > len(values) or stride < least:
            raise DamagedError(f"{len(values)} numbers, expected {count} x {max(stride, least)}")
        table = values[: count * stride].reshape(count, stride)
        params = accessor.findall("param")
        named = [k for k, param in enumerate(params[:stride]) if param.get("name")]
        if len(named) < least or named == list(range(stride)):
            return table  # not a copy, because many primitives may share it
        self.assets.budget.charge(made=8 * count * len(named))
        return table[:, named]

    def bound_look(
        self, symbol: str | None, bound: dict[str | None, Element]
    ) -> tuple[Look | None, str]:
        """The material of a symbol, and the number of its set of texture coordinates or ""."""
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
        """A material, and the name of its texture coordinates."""
        urls = [instance.get("url") for instance in element.iterfind("instance_effect")]
        effect = self.find(urls[0] if urls else None, "effect")
        self.visit(effect)
        inside = effect.iterfind("profile_COMMON/technique/*")
        shader = next((e for e in inside if e.tag in _SHADERS), None)
        if shader is None:
            raise DamagedError(f"its effect has no <profile_COMMON> with {', '.join(_SHADERS)}")
        paths = ("newparam", "profile_COMMON//newparam")
        params = {e.get("sid"): e for path in paths for e in effect.iterfind(path)}
        title = element.get("id")
        if element.find("instance_effect/setparam") is not None:
            self.assets.warn("parameters that a material sets not read", title)

        def values(name: str, default: tuple[float, ...] = ()) -> tuple[float, ...]:
            """A colour or a factor; the default if it has fewer numbers than that."""
            inner = shader.find(f"{name}/*")
            if inner is None or inner.tag == "texture":
                return default
            if inner.tag == "param" and len(params.get(inner.get("ref"), ())):
                inner = params[inner.get("ref")][0]
            found = _numbers(inner).tolist()
            return tuple(found) if len(found) >= len(default) else default

        dark = shader.find("diffuse/texture") is None and max(values("diffuse", _BLACK)[:3]) <= 0.02
        glows = shader.find("emission/texture") is not None
        source = "emission" if shader.tag == "constant" or (glows and dark) else "diffuse"
        for slot in shader:
            if slot.tag not in (source, "transparent") and slot.find("texture") is not None:
                self.assets.warn("maps of COLLADA not read", slot.tag)
        texture, wraps, name = self.texture(shader.find(f"{source}/texture"), params)
        diffuse = values(source, GREY if texture is None else (1.0, 1.0, 1.0))
        if source == "diffuse" and max(values("emission", _BLACK)[:3]) > 0.02:
            self.assets.warn("emission not read", title)
        specular = values("specular", _BLACK) if shader.tag in ("phong", "blinn") else _BLACK
        shininess = values("shininess", (20.0,))[0]
        shininess = shininess if shininess >= 1 else 20.0  # some write 0 to 1

        transparent, opacity = shader.find("transparent"), 1.0
        mode = ("" if transparent is None else transparent.get("opaque")) or "A_ONE"
        factor = values("transparency", (1.0,))[0]
        if transparent is None and 0 < factor < 1:
            self.assets.warn("transparency without <transparent> not used", title)
        picture, *_ = self.texture(shader.find("transparent/texture"), params)
        if picture is not None:
            level = picture[..., 3] if mode[0] == "A" else picture[..., :3].mean(axis=2)
            level = (255 - factor * level if mode.endswith("ZERO") else factor * level).clip(0, 255)
            texture = self.assets.with_alpha(texture, level.round().astype(np.uint8))
        elif transparent is not None:
            clear = [*values("transparent"), 1.0, 1.0, 1.0, 1.0]
            level = factor * (clear[3] if mode[0] == "A" else sum(clear[:3]) / 3)
            if level == 0 and transparent.get("opaque") is None:
                # Several writers mean that nothing is transparent.
                self.assets.warn("transparency 0, opaque is used", title)
                level = 1.0
            opacity = 1 - level if mode.endswith("ZERO") else level
        elif texture is not None and (texture[..., 3] < 255).any():
            self.assets.warn("alpha of textures without <transparent> not used", title)
            opaque = np.full(texture.shape[:2], 255, np.uint8)
            texture = self.assets.with_alpha(texture, opaque)
        title = element.get("name") or title or ""
        made = material(diffuse[:3], specular[:3], shininess, opacity, texture, title)
        return Look(made, wraps=wraps), name

    def texture(
        self, element: Element | None, params: dict[str | None, Element]
    ) -> tuple[np.ndarray | None, tuple[str, str], str]:
        """A texture or None, `Look.wraps`, and the name of its coordinates."""
        if element is None:
            return None, ("repeat", "repeat"), ""
        image, nothing = element.get("texture") or "", Element("none")
        sampler = params.get(image, nothing)
        along, up = (_WRAPS.get(sampler.findtext(f"sampler2D/wrap_{k}", "").strip(), "repeat")
                     for k in "st")  # fmt: skip
        surface = params.get(sampler.findtext("sampler2D/source", "").strip(), nothing)
        image = surface.findtext("surface/init_from", image)
        for instance in sampler.iterfind("sampler2D/instance_image"):
            image = instance.get("url") or ""
        for inner in element.iter():
            if inner.tag in _PLACED and _numbers(inner, 1)[0] != inner.tag.startswith("repeat"):
                self.assets.warn("placement of textures not read", inner.tag)
        found = self.ids.get(("image", image.rpartition("#")[2].strip()), nothing)
        file = (found.findtext("init_from/ref") or found.findtext("init_from") or "").strip()
        picture = self.assets.texture(re.sub(r"^file:/*", "", file)) if file else None
        if not file:
            self.assets.warn(MISSING_TEXTURE, repr(image))
        return picture, (along, up), element.get("texcoord") or ""


def _polygons(
    primitive: Element, stride: int, at: int, positions: np.ndarray, assets: Assets
) -> tuple[np.ndarray, np.ndarray]:
    """The number of corners of each polygon, and the indices [C, stride] of all corners."""

    def rows(element: Element) -> np.ndarray:
        values = _numbers(element)
        if len(values) % stride or (values != np.rint(values)).any():
            raise DamagedError(f"{len(values)} indices, expected {stride} whole numbers per corner")
        return values.astype(np.int64).reshape(-1, stride)

    nothing = np.zeros((0, stride), np.int64)
    blocks = [rows(element) for element in primitive.iterfind("p")]
    if primitive.tag in ("tristrips", "trifans"):
        order = strip if primitive.tag == "tristrips" else fan
        blocks = [block[order(len(block)).ravel()] for block in blocks]
    for element in primitive.iterfind("ph"):
        loops = [rows(child) for child in element if child.tag in ("p", "h")]
        corners = np.concatenate([nothing, *loops])
        where = np.clip(corners[:, at], 0, len(positions) - 1)
        sizes = [len(loop) for loop in loops]
        # Distances of each hole to all corners before it.
        assets.budget.charge(made=48 * np.dot(np.cumsum(sizes)[:-1], sizes[1:]))
        blocks.append(corners[with_holes(positions[where], sizes)])
    corners = np.concatenate([nothing, *blocks])
    if primitive.tag == "polylist":
        counts = _numbers(primitive.find("vcount")).astype(np.int64)
    elif primitive.tag == "polygons":
        counts = np.array([len(block) for block in blocks], np.int64)
    else:
        counts = np.full(-(-len(corners) // 3), 3)
    if (counts < 0).any() or counts.sum() != len(corners):
        raise DamagedError(f"{len(corners)} corners, expected {counts.sum()}")
    return counts, corners
