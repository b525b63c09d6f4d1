"""Small COLLADA and 3MF files."""

from helpers.obj_text import zipped

HALVES = "<triangles count='2' material='m'>{inputs}<p>{p}</p></triangles>"
VERTEX = "<input semantic='VERTEX' source='#v' offset='0'/>"
INSTANCE = (
    "<instance_geometry url='#g'><bind_material><technique_common><instance_material symbol='m' "
    "target='#{target}'>{inputs}</instance_material></technique_common></bind_material>"
    "</instance_geometry>"
)
COLOURED = "<diffuse><color>1 0 0 1</color></diffuse>"
POINTS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
VERTICES = "".join(f"<vertex x='{x}' y='{y}' z='{z}'/>" for x, y, z in POINTS)
TRIANGLES = "".join(f"<triangle v1='{a}' v2='{b}' v3='{c}'/>" for a, b, c in FACES)
MESH = f"<mesh><vertices>{VERTICES}</vertices><triangles>{TRIANGLES}</triangles></mesh>"
SHAPE = f"<object id='1'>{MESH}</object>"


def source(name, numbers, stride=3):
    params = "".join(f"<param name='{c}' type='float'/>" for c in "XYZW"[:stride])
    count = len(numbers.split())
    return (
        f"<source id='{name}'><float_array id='{name}a' count='{count}'>{numbers}</float_array>"
        f"<technique_common><accessor source='#{name}a' count='{count // stride}' "
        f"stride='{stride}'>{params}</accessor></technique_common></source>"
    )


def mesh(primitives, points="0 0 0 1 0 0 1 1 0 0 1 0", more="", name="g"):
    vertices = "<vertices id='v'><input semantic='POSITION' source='#p'/></vertices>"
    inside = f"{source('p', points)}{more}{vertices}{primitives}"
    return f"<geometry id='{name}'><mesh>{inside}</mesh></geometry>"


def dae(
    geometry=None, nodes=None, shading=COLOURED, more="", up="Y_UP", shader="lambert", scene=True
):
    geometry = geometry or mesh(HALVES.format(inputs=VERTEX, p="0 1 2 0 2 3"))
    nodes = nodes or f"<node id='n'>{INSTANCE.format(target='red', inputs='')}</node>"
    used = "<scene><instance_visual_scene url='#s'/></scene>" if scene else ""
    return (
        "<?xml version='1.0'?><COLLADA xmlns='http://www.collada.org/2005/11/COLLADASchema' "
        f"version='1.4.1'><asset><up_axis>{up}</up_axis></asset>"
        "<library_images><image id='i'><init_from>halves.png</init_from></image></library_images>"
        "<library_effects><effect id='e'><profile_COMMON>"
        "<newparam sid='su'><surface type='2D'><init_from>i</init_from></surface></newparam>"
        "<newparam sid='sa'><sampler2D><source>su</source></sampler2D></newparam>"
        f"<technique sid='c'><{shader}>{shading}</{shader}></technique></profile_COMMON></effect>"
        "</library_effects><library_materials><material id='red'><instance_effect url='#e'/>"
        f"</material></library_materials><library_geometries>{geometry}</library_geometries>{more}"
        f"<library_visual_scenes><visual_scene id='s'>{nodes}</visual_scene>"
        f"</library_visual_scenes>{used}</COLLADA>"
    )


def primitive(tag, body, points="0 0 0 1 0 0 1 1 0 0 1 0"):
    return mesh(f"<{tag} count='1'>{VERTEX}{body}</{tag}>", points)


def three_mf(objects=SHAPE, items="<item objectid='1'/>", head="", settings=""):
    space = "xmlns='http://schemas.microsoft.com/3dmanufacturing/core/2015/02' xmlns:p='p'"
    files = {"Metadata/model_settings.config": settings}
    for name, inner in {"a": objects, "b": SHAPE}.items():
        build = f"<build>{items}</build>" if name == "a" else ""
        text = f"{head}<model {space}><resources>{inner}</resources>{build}</model>"
        files[f"3D/{name}.model"] = text
    return zipped(files)
