"""Catalogue of the cars of the racing simulator TORCS, with their wheels.

The folder of a car contains its body and a file of parameters. The body is an `.acc` file: AC3D
with several texture layers, of which the first is the paint. The parameters give the positions and
sizes of the wheels and the name of their model in the folder `wheels`. Models with fewer details
are left out.
"""

import functools
import os
import pathlib
import re
import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np

from data_gen.catalogues.entry import FRACTIONS, Catalogue, Entry, split_of
from data_gen.mesh import UnusableModelError
from data_gen.readers.ac3d import check_assimp, read_ac3d
from data_gen.readers.files import FolderFiles
from data_gen.readers.load import load_model
from data_gen.readers.textures import Assets

_MAX_XML_BYTES = 1 << 20
_WHEELS = "trb1-3"  # for cars without a wheel model
_UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254, "": 1.0}


def wheel_places(parameters: bytes) -> tuple[str, list[tuple[np.ndarray, float, float]]]:
    """The folder of a car's wheel model, and position, radius and width of each wheel in metres.

    Positions are in the axes of the body: x to the front, y up, z to the right.

    Raises:
      UnusableModelError: the file of parameters is damaged or incomplete.
    """
    # Remove the document type: it refers to a file that does not exist.
    text = re.sub(rb"<!DOCTYPE[^>\[]*(\[.*?\]\s*)?>|&[a-z-]+;", b"", parameters, flags=re.DOTALL)
    try:
        tree = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise UnusableModelError(f"parameters not readable: {error}"[:200]) from error
    sections = {s.get("name", ""): s for s in tree.iter("section")}

    def number(section: str, key: str) -> float:
        for each in sections[section].iter("attnum") if section in sections else ():
            if each.get("name") == key:
                try:
                    value = float(each.get("val", "")) * _UNITS.get(each.get("unit", ""), 1.0)
                except ValueError:
                    break
                if np.isfinite(value):
                    return value
        raise UnusableModelError(f"parameters: {key!r} of {section!r} is missing")

    folder = next(
        (s.get("val", "") for s in tree.iter("attstr") if s.get("name") == "3d wheel directory"), ""
    )
    result = []
    for end in ("Front", "Rear"):
        for side in ("Right", "Left"):
            wheel = f"{end} {side} Wheel"
            width = number(wheel, "tire width")
            radius = number(wheel, "rim diameter") / 2 + width * number(
                wheel, "tire height-width ratio"
            )
            place = np.array(
                [number(f"{end} Axle", "xpos"), radius, -number(wheel, "ypos")], np.float64
            )
            result.append((place, radius, width))
    return folder if re.fullmatch(r"[\w.-]+", folder) else _WHEELS, result


def read_car(data: bytes, assets: Assets) -> dict[str, Any]:
    """Arrays of the body and the wheels of a car for `mesh.build_model`; a `readers.load.Reader`.

    Raises:
      UnusableModelError: a file is damaged, too large or empty, or assimp is not installed.
    """
    parts = [read_ac3d(data, assets)]
    name = assets.base.rpartition("/")[2]
    try:
        folder, places = wheel_places(
            assets.files.open(assets.base, f"{name}.xml")[:_MAX_XML_BYTES]
        )
        of_wheel = assets.at(f"wheels/{folder}")
        wheel = read_ac3d(of_wheel.files.open(of_wheel.base, "wheel0.acc"), of_wheel)
    except (FileNotFoundError, UnusableModelError) as error:
        assets.warn(f"no wheels: {error}")
        places = []
    for where, radius, width in places:
        # The outer side of the wheel model points toward -z.
        turn = np.diag([2 * radius, 2 * radius, width])
        if where[2] > 0:
            turn = turn @ np.diag([-1.0, 1.0, -1.0])
        linear = turn.T
        normals = wheel["normals"] @ np.linalg.inv(turn)
        parts.append({**wheel, "vertices": wheel["vertices"] @ linear + where, "normals": normals})
    count = materials = 0
    for part in parts:
        part["faces"] = part["faces"] + count
        part["face_material"] = part["face_material"] + materials
        count += len(part["vertices"])
        materials += len(part["materials"])
    merged = {
        key: np.concatenate([part[key] for part in parts])
        for key in ("vertices", "faces", "normals", "uv", "face_material")
    }
    together = tuple(m for part in parts for m in part["materials"])
    return {**merged, "materials": assets.bounded(together)}


def torcs(
    source: str | os.PathLike[str], *, fractions: tuple[float, float, float] = FRACTIONS
) -> Catalogue:
    """The cars in the data folder of TORCS: `cars/<name>/<name>.acc`.

    Args:
      source: the folder that contains `cars` and `wheels`.
      fractions: fractions of the models for training, validation and test, see `split_of`.

    Raises:
      ValueError: the folder contains no such car, or assimp is not installed.
    """
    root = pathlib.Path(source)
    found = (p for p in root.glob("cars/*/*.acc") if p.stem == p.parent.name)
    names = sorted(p.relative_to(root).as_posix() for p in found)
    if not names:
        raise ValueError(
            f"source {str(source)!r}: expected the data folder of TORCS, with cars/*/*.acc"
        )
    check_assimp("torcs")
    files = FolderFiles(root)
    entries = []
    for name in names:
        load = functools.partial(
            load_model, name, files, up="+y", front="+x", category="car", reader=read_car
        )
        entries.append(Entry(name, "car", split_of(name, fractions), load))
    return Catalogue("torcs", entries, fractions)
