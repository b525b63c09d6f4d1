"""Reader of 3MF files: zip archives of XML."""

import fnmatch
import functools
import io
import posixpath
import re
import urllib.parse
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from data_gen.readers.collada import MAX_XML_BYTES, parsed_xml
from data_gen.readers.model_files import DamagedError, ZipFiles, numbers
from data_gen.readers.parts import Part, transformed
from data_gen.readers.textures import Assets

# Of extensions that a file may require: without colours and names of faces, the surface is right.
_READ = ("/core/", "/production/", "/material/", "/materials/", "/trianglesets/")

# Parts that are no surface, as PrusaSlicer, Bambu Studio and their relatives mark them.
_SLICER = re.compile(
    rb"[\"'](parameter|negative|modifier|support)_?(modifier|volume|part|block|enforce)",
    re.IGNORECASE,
)

_KNOWN = ("mesh", "components", "vertices", "triangles", "trianglesets", "metadatagroup")


def read_3mf(data: bytes, assets: Assets) -> list[Part]:
    """The triangles of a 3MF file. We do not read colours."""
    files = ZipFiles(io.BytesIO(data))
    models = [name for name in files.names if name.endswith(".model")]
    roots = models
    for name in fnmatch.filter(files.names, "Metadata/*.config"):
        settings = files.read(name, MAX_XML_BYTES)
        assets.budget.charge(made=32 * len(settings))
        if _SLICER.search(settings):
            assets.warn("modifiers and cuts of a slicer are read as parts", repr(name))
    if "_rels/.rels" in files.names:
        relations = parsed_xml(files.read("_rels/.rels"), assets)
        targets = [e.get("Target", "") for e in relations if e.get("Type", "").endswith("/3dmodel")]
        paths = [posixpath.normpath(urllib.parse.unquote(t)).lstrip("/") for t in targets]
        roots = [place for path in paths if (place := files.find(path))] or models
    objects: dict[tuple[str, str | None], Element] = {}
    stack: list[tuple[str, Element, np.ndarray]] = []
    for name in dict.fromkeys([*roots, *models]):
        root = _model(files.read(name, MAX_XML_BYTES), assets)
        objects |= {(name, e.get("id")): e for e in root.iterfind("resources/object")}
        stack += [(name, e, np.eye(4)) for e in root.iterfind("build/item") if name in roots]
    if not objects:
        raise DamagedError("it contains no .model file with objects")
    parts: list[Part] = []
    content_of = functools.cache(lambda e: (_mesh(e), e.findall("components/component")))
    while stack:
        name, instance, matrix = stack.pop()
        text = instance.get("transform", "")
        assets.budget.charge(visits=1, made=64 * len(instance.attrib) + 16 * len(text))
        if words := text.split():  # in the order of columns
            matrix = matrix @ np.vstack([numbers(words).reshape(4, 3).T, [0, 0, 0, 1]])
        paths = [v for k, v in instance.attrib.items() if k.endswith("}path")]
        path = (paths or [name])[0].lstrip("/")
        shape = objects.get((path, instance.get("objectid")))
        if shape is None:
            assets.warn("objects of 3MF missing", instance.get("objectid"))
            continue
        if shape.get("type") in ("support", "solidsupport", "other"):
            assets.warn("supports and other objects of 3MF left out", shape.get("id"))
            continue
        mesh, inner = content_of(shape)
        assets.budget.charge(visits=len(inner), faces=len(mesh.counts))
        stack += [(path, component, matrix) for component in inner]
        if len(mesh.counts):
            parts.append(transformed(mesh, matrix[None]))
    return parts


def _model(data: bytes, assets: Assets) -> Element:
    """The root of a .model file. We refuse or name what we do not read."""
    root, spaces = parsed_xml(data, assets), dict[str, str]()
    required = root.get("requiredextensions", "").split()
    events = ElementTree.iterparse(io.BytesIO(data.lstrip()), ("start-ns", "start"))
    for event, value in events if required else ():
        if event == "start":  # of the root
            break
        spaces |= [value]
    for space in [spaces.get(prefix, prefix) for prefix in required]:
        if not any(name in space for name in _READ):
            raise DamagedError(f"it needs the extension {space!r}, which is not read")
    if any(element.get("pid") for element in root.iter()):
        assets.warn("colours and textures of 3MF not read")
    for shape in root.iterfind("resources/object"):
        if any(k.endswith("}meshresolution") and v == "lowres" for k, v in shape.attrib.items()):
            assets.warn("slices of 3MF not read, the mesh is a stand-in", shape.get("id"))
        for element in (*shape, *shape.iterfind("mesh/*")):
            if element.tag not in _KNOWN:
                assets.warn("parts of 3MF objects not read", element.tag)
    return root


def _mesh(shape: Element) -> Part:
    rows = [[v.get(k) for k in "xyz"] for v in shape.iterfind("mesh/vertices/vertex")]
    found = shape.iterfind("mesh/triangles/triangle")
    index = numbers([[t.get(k) for k in ("v1", "v2", "v3")] for t in found], np.int64)
    if index.size and not 0 <= index.min() <= index.max() < len(rows):
        raise DamagedError("faces have missing vertices")
    return Part(numbers(rows).reshape(-1, 3), np.full(len(index), 3), index.ravel())
