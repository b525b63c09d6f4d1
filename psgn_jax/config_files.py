"""Names of configurations: `--config=quickstart` is the file `configs/quickstart.py`.

The files are in `configs/` of a clone, and in `psgn_jax/configs/` of an installed wheel.
"""

import difflib
import pathlib
from collections.abc import Sequence

from psgn_jax.config import ConfigError

_PACKAGE = pathlib.Path(__file__).resolve().parent


def folder() -> pathlib.Path:
    """The folder of the configurations that come with the package."""
    shipped = _PACKAGE / "configs"
    return shipped if shipped.is_dir() else _PACKAGE.parent / "configs"


def names() -> list[str]:
    """Names of the configurations that come with the package."""
    return sorted(path.stem for path in folder().glob("*.py"))


def path_of(value: str) -> str:
    """The path of a configuration that is given as a path or as a name.

    A text after a colon is kept: `authors:small` becomes `.../authors.py:small`.

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


def with_paths(argv: Sequence[str]) -> list[str]:
    """Command-line arguments with the name after `--config` replaced by its path.

    Raises:
      ConfigError: the errors of `path_of`.
    """
    arguments: list[str] = []
    for argument in argv:
        flag, equals, value = argument.partition("=")
        if arguments and arguments[-1] in ("--config", "-config"):
            arguments.append(path_of(argument))
        elif equals and flag in ("--config", "-config"):
            arguments.append(f"{flag}={path_of(value)}")
        else:
            arguments.append(argument)
    return arguments
