"""The text of `render.py --help`: flags, options of catalogues and settings, from docstrings."""

import dataclasses
import inspect
import re
import textwrap
from collections.abc import Callable, Iterator
from typing import Any

from data_gen.catalogues.by_name import CATALOGUES, class_of, option_types
from data_gen.settings import Settings

_WIDTH = 92


def documented(kind: Callable[..., Any]) -> dict[str, str]:
    """The descriptions of arguments or attributes in the docstring of a class, by name."""
    lines = (inspect.getdoc(kind) or "").splitlines()
    heads = [i for i, line in enumerate(lines) if line in ("Args:", "Attributes:")]
    result: dict[str, str] = {}
    names: list[str] = []
    for line in lines[heads[0] + 1 :] if heads else []:
        if line and not line.startswith(" "):
            break
        head = re.match(r"  (\w+(?:, \w+)*): (.*)", line)
        if head:
            names = head[1].split(", ")
            result |= dict.fromkeys(names, head[2])
        else:
            result |= {name: f"{result[name]} {line.strip()}".strip() for name in names}
    return result


def _entry(name: str, text: str) -> str:
    body = textwrap.fill(text, _WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6)
    return f"  {name}\n{body}" if text else f"  {name}"


def _plain(value: Any) -> str:
    """A default value in the form of the command line."""
    if isinstance(value, tuple):
        return "'" + str(value).replace("'", "") + "'" if value else "()"
    return str(value)


def options_of(name: str) -> str:
    """The options of a catalogue with defaults and descriptions."""
    kind = class_of(name)
    texts = documented(kind)
    defaults = inspect.signature(kind).parameters
    out = [f"Options of --catalogue={name}", _entry("--source", texts.get("source", ""))]
    for option in option_types(name):
        value = defaults[option].default
        shown = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
        out.append(_entry(f"--option={option}={shown}", texts.get(option, "")))
    return "\n".join(out)


def _settings(kind: Any, prefix: str) -> Iterator[str]:
    texts = documented(kind)
    sections = []
    for field in dataclasses.fields(kind):
        default = (
            field.default if field.default_factory is dataclasses.MISSING
            else field.default_factory()
        )  # fmt: skip
        if dataclasses.is_dataclass(default):
            sections.append((field.name, type(default)))
        else:
            yield _entry(f"{prefix}{field.name}={_plain(default)}", texts.get(field.name, ""))
    for name, section in sections:
        yield f"\n  {name}: {(inspect.getdoc(section) or '').splitlines()[0]}"
        yield from _settings(section, f"{prefix}{name}.")


def text(summary: str, flags: dict[str, str]) -> str:
    """The complete help text.

    Args:
      summary: description of the command.
      flags: descriptions of the flags, without the flags of settings.
    """
    parts = [summary.strip(), "Flags"]
    parts[-1] += "\n" + "\n".join(_entry(name, meaning) for name, meaning in flags.items())
    parts += [options_of(name) for name in sorted(CATALOGUES)]
    parts.append("Settings, with their defaults\n" + "\n".join(_settings(Settings, "--config.")))
    return "\n\n".join(parts) + "\n"
