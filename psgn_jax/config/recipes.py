"""Names of configurations: `--config=quickstart` means the file `configs/quickstart.py`.

The files are in `configs/` of a clone, and in `psgn_jax/configs/` of an installed wheel.
"""

import ast
import difflib
import pathlib
import runpy
from collections.abc import Sequence
from typing import Any

import ml_collections

from psgn_jax.config.experiment import ConfigError

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
    config: ml_collections.ConfigDict = runpy.run_path(str(folder() / f"{name}.py"))["get_config"]()
    return config


def path_of(value: str) -> str:
    """The path of a configuration that is given as a path or as a name.

    Text after a colon is kept: `authors:small` becomes `.../authors.py:small`.

    Raises:
      ConfigError: there is neither a file nor a configuration with this name.
    """
    given, colon, rest = value.partition(":")
    if pathlib.Path(given).is_file():
        return value
    if given in names():
        return f"{folder() / given}.py{colon}{rest}"
    near = difflib.get_close_matches(pathlib.Path(given).stem, names(), 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise ConfigError(
        f"--config={value}: no such file and no such name; {hint}expected the path of a "
        f"configuration or one of {', '.join(names())}"
    )


_WHAT = (
    "expected a Python file with a function get_config() that returns an "
    "ml_collections.ConfigDict, such as configs/base.py"
)
_LARGEST = 1_000_000


def check_file(value: str) -> None:
    """Checks that a file is a configuration, by loading it.

    Args:
      value: path of the file. Text after a colon is the argument of `get_config`.

    Raises:
      ConfigError: the file is not a configuration, or `get_config` fails; the message states what
        is expected.
    """
    given, colon, rest = value.partition(":")
    path = pathlib.Path(given)
    namespace: dict[str, Any] = {"__name__": "configuration", "__file__": given}
    try:
        if path.stat().st_size > _LARGEST:
            raise ValueError(f"it has more than {_LARGEST} bytes")
        exec(compile(path.read_bytes(), given, "exec"), namespace)
        if not callable(namespace.get("get_config")):
            raise ValueError("it has no function get_config")
        config = namespace["get_config"](*([rest] if colon else []))
        if not isinstance(config, ml_collections.ConfigDict):
            raise TypeError(f"get_config returns {type(config).__name__}")
    except Exception as error:  # the file may contain anything
        why = f"{type(error).__name__}: {error}"
        raise ConfigError(
            f"--config={value} is not a configuration ({why[:200]}); {_WHAT}"
        ) from error


def with_paths(argv: Sequence[str]) -> list[str]:
    """Command-line arguments with the name after `--config` replaced by its path.

    Raises:
      ConfigError: the errors of `path_of` and `check_file`.
    """
    arguments, flags = list(argv), ("--config", "-config")
    for i, argument in enumerate(argv):
        flag, equals, _ = argument.partition("=")
        start = f"{flag}=" if flag in flags and equals else ""
        if start or (i and argv[i - 1] in flags):
            path = path_of(argument.removeprefix(start))
            check_file(path)
            arguments[i] = start + path
    return arguments
