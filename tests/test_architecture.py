"""The dependency rule: imports go only downward; one module imports each heavy package."""

import ast
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "psgn_jax"
DATA_GEN = ROOT / "data_gen"
CONFIGS = ROOT / "configs"

# From the bottom to the top. A module may import from its own layer and from the ones above it
# in this list, never from one below. The longest matching prefix decides.
LAYERS: list[tuple[str, ...]] = [
    ("psgn_jax", "psgn_jax.types", "psgn_jax.structured", "psgn_jax.files",
     "psgn_jax.untrusted", "psgn_jax.claims"),
    ("psgn_jax.config", "psgn_jax.data_config", "psgn_jax.data.schema", "psgn_jax.data.codec",
     "psgn_jax.data.manifest", "psgn_jax.data.dataset",
     "psgn_jax.data.camera", "psgn_jax.data.synsets"),
    ("psgn_jax.command_line", "psgn_jax.config_files", "psgn_jax.default_data",
     "psgn_jax.host_memory", "psgn_jax.cores"),
    ("psgn_jax.losses", "psgn_jax.models", "psgn_jax.data"),
    ("psgn_jax.metrics",),
    ("psgn_jax.viewing",),
    ("psgn_jax.training", "psgn_jax.weights"),
    ("psgn_jax.prediction",),
    ("psgn_jax.portable",),
    ("psgn_jax.page",),
    ("psgn_jax.tasks",),
    ("psgn_jax.training.loop",),
    ("psgn_jax.experiments",),
    ("psgn_jax.human",),
    ("psgn_jax.main", "psgn_jax.evaluate", "psgn_jax.predict", "psgn_jax.demo",
     "psgn_jax.inspect", "psgn_jax.convert", "psgn_jax.export_network", "psgn_jax.page.__main__",
     "psgn_jax.human.__main__",
     "psgn_jax.weights.__main__", "psgn_jax.cli"),
]  # fmt: skip

# Packages that are heavy or optional, and the only modules that may import them.
DOORS = {
    "orbax": {"psgn_jax.training.checkpoint"},
    "tensorboardX": {"psgn_jax.training.log"},
    "grain": {"psgn_jax.data.loader"},
    "array_record": {"psgn_jax.data.dataset"},
    "mitsuba": set(),
    "torch": set(),
    "scipy": {"psgn_jax.losses.emd"},
    "matplotlib": {"psgn_jax.experiments.figures"},
    "cv2": {"psgn_jax.data.segmentation"},
    "rembg": {"psgn_jax.data.masks"},
    "av": {"psgn_jax.viewing.spheres"},
    "gradio": {"psgn_jax.prediction.demo_page"},
    "safetensors": {"psgn_jax.weights.file"},
    "onnx": {"psgn_jax.portable.graph"},
    "onnxruntime": {"psgn_jax.portable.runtime"},
}

# What the data stage may import of the package, and below the only places that import the data
# stage.
DATA_GEN_MAY_IMPORT = {
    "psgn_jax",
    "psgn_jax.types",
    "psgn_jax.files",
    "psgn_jax.structured",
    "psgn_jax.untrusted",
    "psgn_jax.claims",
    "psgn_jax.data",
    "psgn_jax.data.schema",
    "psgn_jax.data.codec",
    "psgn_jax.data.manifest",
    "psgn_jax.data.dataset",
    "psgn_jax.data.synsets",
}
# A study renders its own data.
DATA_GEN_IMPORTERS = {
    "psgn_jax.default_data",
    "psgn_jax.experiments.comparison",
    "psgn_jax.experiments.hidden_depth",
}
DATA_GEN_DOORS = {
    "dask": {"data_gen.cluster"},
    "distributed": {"data_gen.cluster"},
    "mitsuba": {"data_gen.engine"},
    "drjit": {"data_gen.engine"},
    "trimesh": {"data_gen.readers.by_trimesh", "data_gen.catalogues.folder"},
    "jax": set(),
}


def modules(package: pathlib.Path = PACKAGE) -> dict[str, pathlib.Path]:
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported_names(path: pathlib.Path) -> set[str]:
    """Dotted names that a file imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(), str(path))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(str(node.module))
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def imported_files(path: pathlib.Path, known: dict[str, pathlib.Path]) -> set[str]:
    """Modules of `known` that a file imports, by statement or by a string that names one.

    `from package import module` imports the module; `from package import name` the package. In a
    configuration, a string can also be the name of another one (`config_files.load`).
    """
    imported = set()
    for node in ast.walk(ast.parse(path.read_text(), str(path))):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                imported.add(full if full in known else str(node.module))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            given = node.value.partition(":")[0]
            imported |= {given, f"configs.{given}"} if path.parent == CONFIGS else {given}
    return imported & known.keys()


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Modules that import each other, in order; empty if there are none."""
    done: set[str] = set()

    def visit(name: str, path: list[str]) -> list[str]:
        if name in path:
            return [*path[path.index(name) :], name]
        if name in done:
            return []
        for imported in sorted(graph[name]):
            if found := visit(imported, [*path, name]):
                return found
        done.add(name)
        return []

    return next((found for name in sorted(graph) if (found := visit(name, []))), [])


EVERYTHING = modules() | modules(DATA_GEN) | modules(CONFIGS)


def test_circle_finds_one():
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]
    assert circle({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


def test_an_import_given_as_a_string_counts(tmp_path):
    path = tmp_path / "module.py"
    path.write_text('ENTRIES = {"cd": "psgn_jax.losses.chamfer:chamfer_sq"}\n')
    assert imported_files(path, modules()) == {"psgn_jax.losses.chamfer"}


def test_a_configuration_imports_the_one_it_changes():
    assert imported_files(CONFIGS / "rgbd_emd.py", EVERYTHING) == {
        "configs.authors_emd",
        "psgn_jax.config_files",
    }


def test_no_circle_between_files():
    known = EVERYTHING
    graph = {name: imported_files(path, known) - {name} for name, path in known.items()}
    assert not (found := circle(graph)), " imports ".join(found)


LONGEST_FILE = 450


# What a family of objects consists of: the coordinates of its parts, one after another. A file has
# one category, and a function one type of it; cut in two, neither half would say more.
FAMILIES = "data_gen.catalogues.families."


@pytest.mark.parametrize("name", [n for n in EVERYTHING if not n.startswith(FAMILIES)])
def test_no_file_is_long(name):
    assert len(EVERYTHING[name].read_text().splitlines()) <= LONGEST_FILE


PAGES = sorted(p for p in PACKAGE.rglob("*") if p.suffix in {".js", ".html", ".css"})


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_no_file_of_a_page_is_long(path):
    assert len(path.read_text().splitlines()) <= LONGEST_FILE


LONGEST_FUNCTION = 60


@pytest.mark.parametrize("name", [n for n in EVERYTHING if not n.startswith(FAMILIES)])
def test_a_long_function_says_why(name):
    """The reason in the docstring begins with "Deliberately one function: "."""
    for node in ast.walk(ast.parse(EVERYTHING[name].read_text())):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        documented = ast.get_docstring(node) is not None
        first = node.body[0]
        begin = (first.end_lineno or 0) + 1 if documented else node.lineno
        if node.end_lineno - begin + 1 > LONGEST_FUNCTION:
            documentation = ast.get_docstring(node) or ""
            assert "Deliberately one function: " in documentation, f"{name}: {node.name}"


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
    for imported in imported_files(known[name], known):
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


def test_every_module_has_a_layer():
    lowest = set(LAYERS[0])
    for name in modules():
        assert name in lowest or layer_of(name) > 0, name


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
        "import sys, psgn_jax.data.schema, psgn_jax.data.dataset\nassert 'jax' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
