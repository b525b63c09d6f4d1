"""The contract of imports: packages import downward only, heavy packages have one door."""

import ast
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[1]

# A package imports only itself and packages listed before it.
LAYERS = [
    "system", "config", "data", "losses", "models", "viewing", "weights", "prediction",
    "evaluation", "tasks", "training", "studies", "portable", "web", "commands",
]  # fmt: skip
# What only one module may import.
DOORS = {
    "array_record", "dask", "distributed", "drjit", "grain", "matplotlib",
    "mitsuba", "onnx", "onnxruntime", "orbax", "safetensors", "tensorboardX",
}  # fmt: skip
FOR_DATA_GEN = ("array_types", "config.command_line", "config.structured", "data", "system")


def imports_of(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_packages_import_downward_only():
    wrong = []
    for path in (ROOT / "psgn_jax").rglob("*.py"):
        package = path.relative_to(ROOT / "psgn_jax").parts[0]
        if package not in LAYERS:  # __init__, main, array_types
            continue
        for name in imports_of(path):
            first, second, *_ = [*name.split("."), ""]
            later = second in LAYERS and LAYERS.index(second) > LAYERS.index(package)
            if (first == "psgn_jax" and later) or (first == "data_gen" and package != "commands"):
                wrong.append(f"{path.relative_to(ROOT)} imports {name}")
    for path in (ROOT / "data_gen").rglob("*.py"):
        for name in imports_of(path):
            if name.startswith("psgn_jax.") and not name[9:].startswith(FOR_DATA_GEN):
                wrong.append(f"{path.relative_to(ROOT)} imports {name}")
    assert not wrong, "\n".join(wrong)


def test_heavy_packages_have_one_door():
    doors = {}
    for path in [*(ROOT / "psgn_jax").rglob("*.py"), *(ROOT / "data_gen").rglob("*.py")]:
        for name in imports_of(path):
            doors.setdefault(name.partition(".")[0], set()).add(path.relative_to(ROOT).as_posix())
    assert {name: paths for name, paths in doors.items() if name in DOORS and len(paths) > 1} == {}


def test_the_losses_and_the_records_are_light():
    for module, heavy in (
        ("psgn_jax.losses", {"flax", "optax", "grain", "orbax"}),
        ("psgn_jax.data.dataset", {"jax", "grain"}),
    ):
        code = f"import sys, {module}; sys.exit(' '.join({heavy} & set(sys.modules)))"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert done.stderr.strip() == "", f"{module} imports {done.stderr}"
