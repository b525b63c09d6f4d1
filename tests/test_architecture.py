"""The dependency rule: imports go only downward, heavy packages enter by one door each."""

import ast
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "psgn_jax"
DATA_GEN = ROOT / "data_gen"

# From the bottom to the top. A module may import from its own layer and from the ones above it
# in this list, never from one below. The longest matching prefix decides.
LAYERS: list[tuple[str, ...]] = [
    ("psgn_jax", "psgn_jax.types"),
    ("psgn_jax.config", "psgn_jax.data.schema", "psgn_jax.data.camera", "psgn_jax.data.records"),
    ("psgn_jax.losses", "psgn_jax.models", "psgn_jax.data"),
    ("psgn_jax.metrics", "psgn_jax.registry"),
    ("psgn_jax.training", "psgn_jax.prediction"),
    ("psgn_jax.training.loop", "psgn_jax.evaluate", "psgn_jax.predict", "psgn_jax.viewing",
     "psgn_jax.experiments", "psgn_jax.tasks"),
    ("psgn_jax.main", "psgn_jax.demo", "psgn_jax.inspect", "psgn_jax.convert"),
]  # fmt: skip

# Packages that are heavy or optional, and the only modules that may import them.
DOORS = {
    "orbax": {"psgn_jax.training.checkpoint"},
    "tensorboardX": {"psgn_jax.training.log"},
    "grain": {"psgn_jax.data.loader"},
    "array_record": {"psgn_jax.data.records"},
    "mitsuba": set(),
    "torch": set(),
    "scipy": {"psgn_jax.losses.emd"},
    "matplotlib": set(),
    "cv2": {"psgn_jax.data.masks"},
    "rembg": {"psgn_jax.data.masks"},
    "av": {"psgn_jax.viewing.spheres"},
    "gradio": {"psgn_jax.demo"},
}


# What the data stage may import of the package, and the only places where it is imported: the one
# that builds the default data set.
DATA_GEN_MAY_IMPORT = {
    "psgn_jax",
    "psgn_jax.types",
    "psgn_jax.data",
    "psgn_jax.data.schema",
    "psgn_jax.data.records",
}
# A study renders its own data.
DATA_GEN_IMPORTERS = {
    "psgn_jax.data.default",
    "psgn_jax.experiments.ambiguity",
    "psgn_jax.experiments.comparison",
}
DATA_GEN_DOORS = {
    "dask": {"data_gen.cluster"},
    "distributed": {"data_gen.cluster"},
    "mitsuba": {"data_gen.shader", "data_gen.worker"},
    "drjit": {"data_gen.shader", "data_gen.worker"},
    "trimesh": {"data_gen.loading", "data_gen.catalogues.folder"},
    "jax": set(),
}


def modules(package: pathlib.Path = PACKAGE) -> dict[str, pathlib.Path]:
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported_names(path: pathlib.Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(), str(path))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(str(node.module))
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def layer_of(name: str) -> int:
    matches = [
        (len(prefix), index)
        for index, prefixes in enumerate(LAYERS)
        for prefix in prefixes
        if name == prefix or name.startswith(prefix + ".")
    ]
    return max(matches)[1]


@pytest.mark.parametrize("name", list(modules()))
def test_imports_go_downward(name):
    known = modules()
    for imported in imported_names(known[name]) & set(known):
        if imported == "psgn_jax":
            continue
        assert layer_of(imported) <= layer_of(name), f"{name} imports {imported}, a layer above it"


@pytest.mark.parametrize("name", list(modules()))
def test_heavy_packages_enter_by_one_door(name):
    tops = {imported.split(".")[0] for imported in imported_names(modules()[name])}
    for package, doors in DOORS.items():
        assert package not in tops or name in doors, f"{name} imports {package}"


@pytest.mark.parametrize("name", list(modules(DATA_GEN)))
def test_data_gen_imports_the_schema_and_the_records_alone(name):
    path = modules(DATA_GEN)[name]
    imported = {n for n in imported_names(path) if n.split(".")[0] == "psgn_jax"}
    # `from module import name` counts as `module.name` as well; only modules matter.
    imported &= set(modules())
    assert imported <= DATA_GEN_MAY_IMPORT, f"{name} imports {imported - DATA_GEN_MAY_IMPORT}"
    tops = {n.split(".")[0] for n in imported_names(path)}
    for package, doors in DATA_GEN_DOORS.items():
        assert package not in tops or name in doors, f"{name} imports {package}"


@pytest.mark.parametrize("name", list(modules()))
def test_nothing_imports_data_gen(name):
    tops = {n.split(".")[0] for n in imported_names(modules()[name])}
    assert "data_gen" not in tops or name in DATA_GEN_IMPORTERS, f"{name} imports data_gen"


def test_catalogues_import_is_light():
    code = (
        "import sys, data_gen.catalogues.procedural, data_gen.catalogues.sh3f\n"
        "heavy = {'jax', 'flax', 'mitsuba', 'drjit', 'trimesh', 'orbax', 'grain'}\n"
        "loaded = {m.split('.')[0] for m in sys.modules} & heavy\n"
        "assert not loaded, loaded\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_every_layer_entry_is_a_module_or_planned():
    for name in modules():
        assert name == "psgn_jax" or layer_of(name) > 0 or name == "psgn_jax.types", name


def test_losses_import_is_light():
    code = (
        "import sys, psgn_jax.losses, psgn_jax.losses.chamfer\n"
        "heavy = {'flax', 'orbax', 'tensorboardX', 'optax', 'grain', 'mitsuba', 'ml_collections'}\n"
        "loaded = {m.split('.')[0] for m in sys.modules} & heavy\n"
        "assert not loaded, loaded\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_records_need_no_jax():
    code = (
        "import sys, psgn_jax.data.schema, psgn_jax.data.records\nassert 'jax' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
