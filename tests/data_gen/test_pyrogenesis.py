import io
import pickle
import struct
import zipfile

import numpy as np
import pytest
from PIL import Image

from data_gen.catalogues.by_name import open_catalogue
from data_gen.mesh import UnusableModelError, face_areas, face_normals
from data_gen.readers import actors, archives
from data_gen.readers.files import Files
from data_gen.readers.pmd import read_pmd

IDENTITY = (0, 0, 0, 0, 0, 0, 1)
QUARTER_ABOUT_Y = (0, 0, 0, 0, 2**-0.5, 0, 2**-0.5)
CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def pmd(low=(0, 0, 0), size=(1, 1, 1), *, bones=(), bone=255, props=(), version=4):
    """A box as a PMD file; `props` are (name, state, bone)."""
    data = b""
    faces = []
    count = 0
    for side in SIDES:
        corners = CORNERS[list(side)]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal = normal if normal @ (corners.mean(axis=0) - 0.5) > 0 else -normal
        for corner, uv in zip(corners, [(0, 0), (1, 0), (1, 1), (0, 1)], strict=True):
            data += struct.pack("<6f", *(np.array(low) + corner * size), *normal)
            data += struct.pack("<2f", *uv) * (2 if version == 4 else 1)
            data += bytes([bone, 255, 255, 255]) + struct.pack("<4f", 1, 0, 0, 0)
        faces += [(count, count + 1, count + 2), (count, count + 2, count + 3)]
        count += 4
    data = struct.pack("<I", count) + (struct.pack("<I", 2) if version == 4 else b"") + data
    if version == 4:  # the number of texture coordinates precedes the vertices
        data = struct.pack("<II", count, 2) + data[8:]
    data += struct.pack("<I", len(faces)) + b"".join(struct.pack("<3H", *f) for f in faces)
    data += struct.pack("<I", len(bones)) + b"".join(struct.pack("<7f", *b) for b in bones)
    data += struct.pack("<I", len(props))
    for name, state, owner in props:
        data += struct.pack("<I", len(name)) + name.encode() + struct.pack("<7f", *state)
        data += bytes([owner])
    return b"PSMD" + struct.pack("<II", version, len(data)) + data


def psa(*states):
    data = struct.pack("<I", 4) + b"idle" + struct.pack("<fII", 1.0, len(states), 1)
    return b"PSSA" + struct.pack("<II", 1, 0) + data + b"".join(
        struct.pack("<7f", *s) for s in states
    )  # fmt: skip


def picture(pixels, kind="PNG"):
    stream = io.BytesIO()
    Image.fromarray(np.array(pixels, np.uint8)).save(stream, kind)
    return stream.getvalue()


def actor(*groups, material="plain.xml"):
    body = "".join("<group>" + "".join(g) + "</group>" for g in groups)
    return f'<actor version="1">{body}<material>{material}</material></actor>'.encode()


def variant(mesh="", texture="", props=(), name="", frequency=1, file="", more=""):
    text = f"<mesh>{mesh}</mesh>" if mesh else ""
    if texture:
        text += f'<textures><texture file="{texture}" name="baseTex"/></textures>'
    text += "<props>" + "".join(
        f'<prop actor="{a}" attachpoint="{p}"/>' for p, a in props
    ) + "</props>"  # fmt: skip
    file = f'file="{file}"' if file else ""
    return f'<variant name="{name}" frequency="{frequency}" {file}>{text}{more}</variant>'


def material(define):
    return f'<material><define name="{define}" value="1"/></material>'.encode()


RED_AND_HALF = [[[200, 0, 0, 255], [200, 0, 0, 0]]]


def archive(path, **changes):
    files = {
        # A body whose bone is rotated by the pose, with a hat at a prop point on the bone.
        "art/meshes/body.dae.cached.pmd": pmd(
            size=(1, 2, 3), bones=[IDENTITY], bone=0, props=[("head", (0, 2, 0, 0, 0, 0, 1), 0)]
        ),
        "art/meshes/hat.pmd": pmd(version=3),
        "art/meshes/house_01.pmd": pmd(low=(0, -4, 0), size=(2, 6, 2)),
        "art/meshes/house_02.pmd": pmd(size=(2, 1, 2)),
        "art/animation/idle.dae.cached.psa": psa(QUARTER_ABOUT_Y),
        "art/textures/skins/skin.dds.cached.dds": picture(RED_AND_HALF, "DDS"),
        "art/textures/skins/leaf.png": picture(RED_AND_HALF),
        "art/materials/plain.xml": b"<material/>",
        "art/materials/player.xml": material("USE_PLAYERCOLOR"),
        "art/materials/leaf.xml": material("USE_TRANSPARENT"),
        "art/variants/pose.xml": b'<variant><animations><animation file="idle.dae" name="Idle"/>'
        b"</animations></variant>",
        "art/actors/units/rome/soldier.xml": actor(
            [variant("body.dae", "skin.dds", [("head", "hats/hat.xml")])],
            [variant(file="pose.xml")],
            [variant("hat.pmd", name="death", frequency=9)],
            material="player.xml",
        ),
        "art/actors/hats/hat.xml": actor([variant("hat.pmd", "leaf.png")], material="leaf.xml"),
        "art/actors/structures/rome/house.xml": actor(
            [variant("house_01.pmd", "leaf.png"), variant("house_02.pmd", "leaf.png")]
        ),
        "art/actors/structures/rome/house_decal.xml": actor([variant("house_01.pmd")]),
        "art/actors/flora/trees/gone.xml": actor([variant("nowhere.dae")]),
        "art/actors/flora/trees/torn.xml": b"<actor><group>",
        "../../evil.png": b"x",
    } | {k: v for k, v in changes.items() if v is not None}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for name, data in files.items():
            out.writestr(name, data)
    return path


def models(path, **options):
    return {e.model_id: e for e in open_catalogue("pyrogenesis", path, **options).entries()}


def test_which_actors_are_models(tmp_path):
    found = models(archive(tmp_path / "public.zip"))
    assert {n: e.category for n, e in found.items()} == {
        "flora/trees/gone": "tree",
        "flora/trees/torn": "tree",
        "structures/rome/house": "building",
        "structures/rome/house-2": "building",
        "units/rome/soldier": "person",
    }
    # Meshes whose names differ only in a number are in the same split.
    assert len({e.split for n, e in found.items() if "house" in n}) == 1
    assert len(open_catalogue("pyrogenesis", tmp_path)) == len(found)
    assert len(models(tmp_path / "public.zip", shapes=1)) == len(found) - 1
    for entry in pickle.loads(pickle.dumps(list(found.values()))):
        if "trees" not in entry.model_id:
            assert entry.load().category == entry.category


def test_an_actor_is_put_together_in_its_idle_pose(tmp_path):
    model = models(archive(tmp_path / "public.zip"))["units/rome/soldier"].load()
    assert not model.warnings
    assert len(model.faces) == 24
    body, hat = (model.vertices[model.faces[i : i + 12]].reshape(-1, 3) for i in (0, 12))
    # The body is 1 wide, 2 high and 3 deep; the quarter turn makes its depth its width.
    extent = np.ptp(body, axis=0)
    np.testing.assert_allclose(extent / extent[2] * 2, [1, 3, 2], atol=1e-5)
    assert hat[:, 2].min() == pytest.approx(body[:, 2].max(), abs=1e-6)
    outward = face_normals(model.vertices, model.faces)
    middle = np.repeat([body.mean(axis=0), hat.mean(axis=0)], 12, axis=0)
    centre = model.corners().mean(axis=1)
    assert (((centre - middle) * outward).sum(axis=1) > 0).all()


def test_the_front_is_where_the_engine_has_it(tmp_path):
    # Left-handed axes with z to the front and x to the right: right is -y of the project.
    long = pmd(size=(1, 1, 5), props=[("mark", (3, 0, 5, 0, 0, 0, 1), 255)])
    files = {
        "art/meshes/long.pmd": long,
        "art/actors/units/rome/long.xml": actor(
            [variant("long.pmd", props=[("mark", "hats/hat.xml")])]
        ),
    }
    model = models(archive(tmp_path / "public.zip", **files))["units/rome/long"].load()
    body, mark = (model.vertices[model.faces[i : i + 12]].reshape(-1, 3) for i in (0, 12))
    assert mark[:, 0].min() >= body[:, 0].max() - 1e-6
    assert mark[:, 1].max() < body[:, 1].min()


def test_alpha_means_what_the_material_says(tmp_path):
    found = models(archive(tmp_path / "public.zip"))
    by_name = {m.name: m for m in found["units/rome/soldier"].load().materials}
    skin, leaf = by_name["skin.dds"].texture[0], by_name["leaf.png"].texture[0]
    assert skin[0].tolist() == [200, 0, 0, 255]
    assert skin[1, 3] == 255
    assert tuple(np.round(skin[1, :3] / 255, 2)) in {tuple(np.round(c, 2)) for c in actors._PLAYERS}
    assert leaf[:, 3].tolist() == [255, 0]
    house = found["structures/rome/house"].load().materials[0].texture[0]
    assert house.tolist() == [[200, 0, 0, 255], [200, 0, 0, 255]]


def test_buildings_have_no_foundations(tmp_path):
    model = models(archive(tmp_path / "public.zip"))["structures/rome/house"].load()
    # 4 of the 6 units of height are below the ground.
    extent = np.ptp(model.vertices, axis=0)
    np.testing.assert_allclose(extent / extent[2], 1, atol=1e-6)
    area = face_areas(model.vertices, model.faces).sum() / extent[2] ** 2
    assert area == pytest.approx(5)
    corners = model.corners().reshape(-1, 3)
    v = model.uv.reshape(-1, 2)
    walls = np.abs(model.normals.reshape(-1, 3)[:, 2]) < 0.5
    assert 0 < v[walls & (corners[:, 2] < 1e-6)].max() <= 1


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda d: b"", "PSMD"),
        (lambda d: b"XXXX" + d[4:], "PSMD"),
        (lambda d: d[:4] + struct.pack("<I", 9) + d[8:], "version 9"),
        (lambda d: d[:12] + struct.pack("<I", 1 << 31) + d[16:], "truncated"),
        (lambda d: d[:16] + struct.pack("<I", 1 << 30) + d[20:], "texture coordinates"),
        (lambda d: d[: len(d) // 2], "truncated"),
        (lambda d: d[:20] + struct.pack("<f", float("nan")) + d[24:], "not finite"),
    ],
)
def test_bad_meshes_are_refused(change, match, tmp_path):
    files = {"art/meshes/body.dae.cached.pmd": change(pmd())}
    entry = models(archive(tmp_path / "public.zip", **files))["units/rome/soldier"]
    with pytest.raises(UnusableModelError, match=match):
        entry.load()


def test_every_torn_mesh_is_refused():
    data = pmd(bones=[IDENTITY], props=[("head", IDENTITY, 0)])
    assert len(read_pmd(data).faces) == 12
    for stop in range(0, len(data), 13):
        with pytest.raises(UnusableModelError):
            read_pmd(data[:stop])
    with pytest.raises(UnusableModelError, match="limit of 5"):
        read_pmd(data, 5)


def test_hostile_archives(tmp_path):
    loop = {
        "art/actors/units/rome/loop.xml": actor(
            [variant("body.dae", props=[("head", "units/rome/loop.xml")] * 3)]
        ),
        "art/actors/units/rome/bomb.xml": b'<!DOCTYPE a [<!ENTITY b "c">]><actor/>',
        "art/actors/units/rome/huge.xml": b"<actor>" + b" " * (2 << 20) + b"</actor>",
        "art/actors/units/rome/up.xml": actor([variant("../../../../body.dae", "../../evil.png")]),
        "art/actors/units/rome/big.xml": actor([variant("big.pmd")]),
        "art/meshes/big.pmd": b"\0" * (33 << 20),
    }
    found = models(archive(tmp_path / "public.zip", **loop))
    for name, match in {
        "units/rome/loop": "parts",
        "units/rome/bomb": "entities",
        "units/rome/huge": "more than the limit|zip bomb",
        "units/rome/up": "missing",
        "units/rome/big": "more than the limit|zip bomb",
        "flora/trees/gone": "missing",
        "flora/trees/torn": "not readable as XML",
    }.items():
        with pytest.raises(UnusableModelError, match=match) as caught:
            found[name].load()
        assert "\n" not in str(caught.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["public.zip"]


def test_a_missing_texture_or_prop_is_a_warning(tmp_path):
    files = {
        "art/textures/skins/leaf.png": b"no picture",
        "art/actors/hats/hat.xml": actor([variant("gone.pmd")]),
    }
    found = models(archive(tmp_path / "public.zip", **files))
    model = found["units/rome/soldier"].load()
    assert len(model.faces) == 12
    assert any("gone.pmd" in w for w in model.warnings)
    assert any("leaf.png" in w for w in found["structures/rome/house"].load().warnings)


def test_wrong_sources_are_told(tmp_path):
    with pytest.raises(ValueError, match=r"public\.zip"):
        open_catalogue("pyrogenesis", tmp_path)
    (tmp_path / "public.zip").write_bytes(b"PK nonsense")
    with pytest.raises(ValueError, match="cannot be read"):
        open_catalogue("pyrogenesis", tmp_path)
    with zipfile.ZipFile(tmp_path / "public.zip", "w") as out:
        out.writestr("a.txt", "")
    with pytest.raises(ValueError, match="no actors"):
        open_catalogue("pyrogenesis", tmp_path)
    with pytest.raises(ValueError, match="colours"):
        open_catalogue("pyrogenesis", archive(tmp_path / "b.zip"), colours=0)


def test_archives_are_files_of_models(tmp_path):
    files = archives.ZipFiles(archive(tmp_path / "public.zip"))
    assert isinstance(files, Files)
    with pytest.raises(FileNotFoundError):
        files.open("", "../../evil.png")
