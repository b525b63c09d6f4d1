"""Names of configurations: `--config=quickstart` means the file `configs/quickstart.py`.

The files are in `configs/` of a clone, and in `psgn_jax/configs/` of an installed wheel.
"""

import ast
import pathlib

import ml_collections

from psgn_jax.config.command_line import load_file
from psgn_jax.config.structured import ConfigError, suggestion

_PACKAGE = pathlib.Path(__file__).resolve().parents[1]


def folder() -> pathlib.Path:
    """The folder of the configurations that come with the package."""
    shipped = _PACKAGE / "configs"
    return shipped if shipped.is_dir() else _PACKAGE.parent / "configs"


def names() -> list[str]:
    """Names of the configurations that come with the package."""
    return sorted(path.stem for path in folder().glob("*.py"))


def descriptions() -> dict[str, str]:
    """The first line of each configuration's docstring, by name."""
    texts = {n: ast.get_docstring(ast.parse((folder() / f"{n}.py").read_bytes())) for n in names()}
    return {name: (text or "").partition("\n")[0] for name, text in texts.items()}


def load(name: str) -> ml_collections.ConfigDict:
    """The configuration with this name, from which other configurations and studies start."""
    return load_file(str(folder() / f"{name}.py"))


def path_of(value: str) -> str:
    """The path of a configuration that is given as a path or as a name; `ConfigError` if neither.

    Text after a colon is kept: `authors:small` becomes `.../authors.py:small`.
    """
    given, colon, rest = value.partition(":")
    if pathlib.Path(given).is_file():
        return value
    if given in names():
        return f"{folder() / given}.py{colon}{rest}"
    hint = suggestion(pathlib.Path(given).stem, names())
    raise ConfigError(
        f"--config={value}: no such file and no such name; {hint}expected the path of a "
        f"configuration or one of {', '.join(names())}"
    )
