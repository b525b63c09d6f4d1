"""Named configurations: `--config=quickstart` means the file `configs/quickstart.py`."""

import ast
import pathlib

import ml_collections

from psgn_jax.config.command_line import load_file, named_file
from psgn_jax.system.processes import ROOT


def folder() -> pathlib.Path:
    """The folder of the configurations: in a wheel `psgn_jax/configs/`, in a clone `configs/`."""
    shipped = ROOT / "psgn_jax" / "configs"
    return shipped if shipped.is_dir() else ROOT / "configs"


def names() -> list[str]:
    return sorted(path.stem for path in folder().glob("*.py"))


def descriptions() -> dict[str, str]:
    """The first line of each configuration's docstring, by name."""
    texts = {n: ast.get_docstring(ast.parse((folder() / f"{n}.py").read_bytes())) for n in names()}
    return {name: (text or "").partition("\n")[0] for name, text in texts.items()}


def load(name: str) -> ml_collections.ConfigDict:
    """The configuration with this name, for configurations and studies that build on it."""
    return load_file(str(folder() / f"{name}.py"))


def path_of(value: str) -> str:
    """`named_file` for the package's configurations."""
    return named_file(value, {name: str(folder() / f"{name}.py") for name in names()})
