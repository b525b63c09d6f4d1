"""AC3D files for tests, and their reading."""

from data_gen.readers.ac3d import read_ac3d
from data_gen.readers.files import FolderFiles
from data_gen.readers.textures import Assets

MATERIALS = (
    'MATERIAL "rouge é" rgb 1 0 0  amb 1 1 1  emis 0 0 0  spec 0.5 0.5 0.5  shi 64  trans 0\n'
    'MATERIAL "rouge é" rgb 0 0 1  amb 1 1 1  emis 0 0 0  spec 0 0 0  shi 1  trans 0.75\n'
)
CUBE = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def obj(kind="poly", *, lines=(), points=(), faces=(), mat=0, flags=0x00, kids=()):
    """An object; `faces` are indices, or (index, u, v)."""
    text = [f"OBJECT {kind}", 'name "été"', *lines]
    if points:
        text.append(f"numvert {len(points)}")
        text += [" ".join(str(c) for c in p) for p in points]
        text.append(f"numsurf {len(faces)}")
        for face in faces:
            text += [f"SURF 0x{flags:02x}", f"mat {mat}", f"refs {len(face)}"]
            text += [" ".join(map(str, r if isinstance(r, tuple) else (r, 0, 0))) for r in face]
    return "\n".join([*text, f"kids {len(kids)}", *kids])


def cube(**options):
    return obj(points=CUBE, faces=SIDES, **options)


def write(path, *objects):
    text = f"AC3Db\n{MATERIALS}{obj('world', kids=objects)}\n"
    path.write_text(text, encoding="utf-8")
    return path


def read(path):
    """The arrays of a file, before they are cleaned and normalised, and the warnings."""
    assets = Assets(FolderFiles(path.parent))
    return read_ac3d(path.read_bytes(), assets), assets.warnings
