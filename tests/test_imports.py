import ast
import functools
import re

from helpers.commands import ROOT, python

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
PATHS = [*(ROOT / "psgn_jax").rglob("*.py"), *(ROOT / "data_gen").rglob("*.py")]
FOR_DATA_GEN = (
    "array_types", "config.command_line", "config.data", "config.structured", "data", "system",
)  # fmt: skip


@functools.cache
def imports_of(path, lazy=True):
    """The names that a file imports, those in functions only with `lazy`."""
    names, tree = [], ast.parse(path.read_text())
    for node in ast.walk(tree) if lazy else tree.body:
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


def test_packages_import_downward_only():
    wrong = []
    for path in PATHS:
        root, package, *_ = path.relative_to(ROOT).parts
        own = LAYERS.index(package) if package in LAYERS else len(LAYERS)  # __init__, main
        for name in imports_of(path):
            first, second, *_ = [*name.split("."), ""]
            if root == "data_gen":
                bad = first == "psgn_jax" and not name[9:].startswith(FOR_DATA_GEN)
            elif first == "data_gen":
                bad = package in LAYERS and package != "commands"
            else:
                bad = first == "psgn_jax" and second in LAYERS[own + 1 :]
            if bad:
                wrong.append(f"{path.relative_to(ROOT)} imports {name}")
    assert not wrong, "\n".join(wrong)


def test_the_page_of_the_architecture_draws_the_layers():
    page = (ROOT / "docs" / "architecture.md").read_text()
    drawing = page.partition("```text\n")[2].partition("```")[0]
    assert re.findall(r"^(\w+) {3,}\w", drawing, re.MULTILINE) == LAYERS[::-1]


def test_heavy_packages_have_one_door():
    doors = {}
    for path in PATHS:
        for name in imports_of(path):
            doors.setdefault(name.partition(".")[0], set()).add(path.relative_to(ROOT).as_posix())
    assert {name: paths for name, paths in doors.items() if name in DOORS and len(paths) > 1} == {}


def test_the_package_the_losses_and_the_records_are_light():
    code = "import sys\n"
    for module, heavy in (
        ("psgn_jax", {"jax", "numpy"}),
        ("psgn_jax.data.dataset", {"jax", "grain"}),
        ("psgn_jax.losses", {"flax", "optax", "grain", "orbax"}),
    ):
        code += f"import {module}; assert not {heavy} & set(sys.modules), {module!r}\n"
    python(code)


# Third-party packages are imported first, because some of them change the process.
_IMPORT = """
import importlib, logging, multiprocessing, os, signal, sys, threading, warnings
from absl import flags
import absl.logging, jax, multiprocessing.util, multiprocessing.resource_tracker

def state():
    loggers = [logging.getLogger(name) for name in (None, "absl", "jax", "orbax")]
    return {
        "sys": (list(sys.path), sys.excepthook, sys.unraisablehook, sys.flags),
        "environment": dict(os.environ),
        "logging": [(each.level, list(each.handlers), list(each.filters)) for each in loggers],
        "warnings": list(warnings.filters),
        "signals": [signal.getsignal(number) for number in signal.valid_signals()],
        "flags": [{name: flags.FLAGS[name].value for name in flags.FLAGS}, flags.FLAGS.is_parsed()],
        "jax": dict(jax.config.values),
        "threads": threading.active_count(),
        "multiprocessing": (
            multiprocessing.get_start_method(allow_none=True), multiprocessing.active_children(),
            {name: value for name, value in vars(multiprocessing.util).items() if callable(value)},
        ),
    }

for number, names in enumerate((THIRD, OWN)):
    before = state()
    for name in names:
        try:
            importlib.import_module(name)
        except ModuleNotFoundError as error:
            assert error.name.partition(".")[0] not in ("psgn_jax", "data_gen"), error
after = state()
for key in before:
    assert before[key] == after[key], (key, before[key], after[key])
"""


def test_importing_any_module_changes_nothing_else():
    own = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in PATHS]
    own = [name.removesuffix(".__init__") for name in own]
    third = {name for path in PATHS for name in imports_of(path, lazy=False)}
    third = {name for name in third if not name.startswith(("psgn_jax", "data_gen"))}
    code = _IMPORT.replace("THIRD", repr(sorted(third))).replace("OWN", repr(sorted(own)))
    python(code)
