"""Commands: flags, `--help`, errors in one line, and logging to the terminal.

def main(argv: Sequence[str] | None = None) -> int:
    flags = Flags("psgn view NPZ... --out=FILE", __doc__)
    flags.path("out", None, "HTML file to write.")
    return flags.run(_main, argv)
"""

import ast
import functools
import pathlib
import re
import runpy
import shlex
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from absl import flags as absl_flags

from psgn_jax.config.structured import ConfigError, flatten, suggestion
from psgn_jax.system.errors import Exit, exit_code_of
from psgn_jax.system.files import local_path
from psgn_jax.system.terminal import log_to_terminal, nothing_reads_output
from psgn_jax.system.untrusted import message_line

HELP = {"--help", "-help", "-h", "-?", "--helpshort", "--helpfull"}
_LARGEST = 1_000_000  # bytes of a configuration
_CHANGE = re.compile(r"--?(?:no)?config\.([\w.]+)(?:=(.*))?", re.DOTALL)


class Flags:
    """The flags and arguments of one command, apart from the flags of the calling program.

    `string`, `integer`, `float`, `bool`, `enum`, `list` and `multi_string` define a flag, with the
    parameters of `absl.flags.DEFINE_string` and so on.
    """

    def __init__(self, usage: str, doc: str | None, details: Callable[[], str] = str) -> None:
        """A command without flags; `doc` and `details()` are above and below the flags in `--help`.

        `usage` is the command with its arguments. `SRC DST`: two arguments; `NPZ...`: one or more;
        `[NAME...]`: any number; `--out=FILE`: a required flag.
        """
        self._usage, self._doc, self._details = usage, doc, details
        self._paths: list[str] = []
        self._config: tuple[Any, Callable[[str], str]] | None = None
        self.values: Any = absl_flags.FlagValues()  # by name; set by `run`
        self.arguments: list[str] = []  # without the flags
        self.config_file = ""  # path of the configuration
        self.settings: Any = None  # the file's `ConfigDict` with the changed fields
        self.fields: list[str] = []  # names of the fields that `--config.FIELD=VALUE` changed

    def __getattr__(self, kind: str) -> Any:
        return functools.partial(getattr(absl_flags, f"DEFINE_{kind}"), flag_values=self.values)

    def path(self, name: str, default: Any, text: str, kind: str = "string") -> None:
        """Defines a flag for a file or folder on this machine, or of another `kind` for several."""
        self._paths.append(name)
        getattr(self, kind)(name, default, text)

    def config(self, defaults: Any, path_of: Callable[[str], str] = str, file: str = "") -> None:
        """Defines `--config=FILE` (default: `file`) and `--config.FIELD=VALUE`.

        `defaults` is a dataclass with all fields. `path_of` maps the value of `--config` to a path.
        """
        self._config = defaults, path_of
        self.path("config", file, "A configuration; --config.FIELD=VALUE changes a field of it.")

    def given(self, *names: str) -> list[str]:
        """The flags among `names` that are on the command line, as `--name`."""
        return [f"--{name}" for name in names if self.values[name].present]

    def run(
        self,
        body: Callable[["Flags"], int | None],
        argv: Sequence[str] | None = None,
        wrong_input: tuple[type[Exception], ...] = (),
    ) -> int:
        """Parses `argv` (None = the process's arguments), runs `body` and returns the exit code.

        From now on, messages are logged to the terminal. An error that the user can fix becomes one
        line on stderr: an error with an `exit_code_of`, or of a type in `wrong_input`.
        """
        argv = list(sys.argv[1:] if argv is None else argv)
        if HELP.intersection(argv[: argv.index("--") if "--" in argv else None]):
            sys.stdout.write(self._help())
            return 0
        log_to_terminal()
        try:
            self._parse(argv)
            return body(self) or 0
        except Exception as error:
            if isinstance(error, BrokenPipeError) and nothing_reads_output():
                return Exit.CLOSED_PIPE
            code = exit_code_of(error) or (Exit.ERROR if isinstance(error, wrong_input) else None)
            if code is None:
                raise
            # Messages begin with the name of the wrong argument; a flag gets its dashes.
            message = message_line(error)
            dashes = "--" * (message.partition("=")[0] in self.values)
            sys.stderr.write(f"error: {dashes}{message}\n")
            return code
        except KeyboardInterrupt:
            sys.stderr.write("stopped by Ctrl-C\n")
            return Exit.CTRL_C

    def _parse(self, argv: Sequence[str]) -> None:
        changes = [*filter(None, map(_CHANGE.fullmatch, argv if self._config else ()))]
        others = set(argv) - {match[0] for match in changes}
        try:
            self.arguments = self.values(["psgn", *(x for x in argv if x in others)])[1:]
        except (absl_flags.Error, TypeError, ValueError) as error:
            raise ConfigError(str(error)) from error
        for flag in (self.values[name] for name in self._paths):
            if isinstance(flag.value, list):
                flag.value = [local_path(path, f"--{flag.name}") for path in flag.value]
            elif flag.value or flag.present:  # --workdir=$RUN without this variable is a mistake
                flag.value = local_path(flag.value, f"--{flag.name}")
        _, _, *needed = self._usage.split()
        for flag in re.findall(r"--(\w+)=", self._usage):
            if not self.values[flag].value:
                raise ConfigError(f"--{flag} is missing; usage: {self._usage}")
        names = [name for name in needed if not name.startswith("-")]
        fewest = sum(not name.startswith("[") for name in names)
        most = len(names) if "..." not in self._usage else len(self.arguments)
        if len(self.arguments) > most:
            wrong = self.arguments[most]
            raise ConfigError(f"unexpected argument {wrong!r}; usage: {self._usage}")
        if len(self.arguments) < fewest:
            missing = names[len(self.arguments)].rstrip(".")
            raise ConfigError(f"{missing} is missing; usage: {self._usage}")
        if self._config is not None:
            defaults, path_of = self._config
            self.config_file = path_of(self.values.config)
            self.settings = load_file(self.config_file)
            self._change(flatten(defaults), changes)

    def _change(self, defaults: dict[str, Any], changes: Sequence[re.Match[str]]) -> None:
        with self.settings.unlocked(), self.settings.ignore_type():
            for match in changes:
                name, text = match.groups()
                if name not in defaults or text is None:
                    hint = suggestion(name, defaults) if name not in defaults else ""
                    raise ConfigError(f"{match[0]}: {hint}accepted: --config.FIELD=VALUE")
                value = _parsed(text, defaults[name])
                for section in reversed(name.split(".")):
                    value = {section: value}
                self.settings.update(value)
                self.fields.append(name)

    def _help(self) -> str:
        lines = [f"usage: {self._usage}", "", (self._doc or "").strip(), "", "Flags"]
        for name in self.values:
            flag = self.values[name]
            shown = f"[no]{name}" if flag.boolean else name
            text = " ".join(str(flag.help).split())
            if flag.default_as_str not in (None, "''", "'false'", "'[]'"):
                text += f" (default: {str(flag.default_as_str).strip(chr(39))})"
            indents: Any = {"initial_indent": "  ", "subsequent_indent": " " * 6}
            lines.append(textwrap.fill(f"--{shown}: {text}", 100, **indents))
        lines.append(self._details())
        if self._config is not None:
            fields = flatten(self._config[0]).items()
            lines += ["", "Fields with their defaults"]
            lines += [f"  --config.{name}={shlex.quote(str(value))}" for name, value in fields]
        return "\n".join(lines).rstrip() + "\n"


_BOOLEANS = {"true": True, "t": True, "1": True, "false": False, "f": False, "0": False}


def _parsed(text: str, default: Any) -> Any:
    """`text` converted to the default's type, or unchanged, so that `parse` refuses it."""
    try:
        if isinstance(default, bool):
            return _BOOLEANS[text.lower()]
        if isinstance(default, int | float):
            return type(default)(text)
        if isinstance(default, tuple):
            value = ast.literal_eval(text)
            return value if isinstance(value, tuple | list) else (value,)
    except (KeyError, ValueError, SyntaxError):
        return tuple(text.split(",")) if isinstance(default, tuple) else text
    return text


def named_file(value: str, files: Mapping[str, str]) -> str:
    """The path of a configuration from its path or name; `ConfigError` if there is neither."""
    if pathlib.Path(value.partition(":")[0]).is_file():  # the file's argument follows a colon
        return value
    if value in files:
        return files[value]
    hint = suggestion(pathlib.Path(value.rpartition(":")[2]).stem, files)
    raise ConfigError(
        f"--config={value}: no such file and no such name; {hint}expected the path of a "
        f"configuration or one of {', '.join(files)}"
    )


def load_file(value: str) -> Any:
    """Executes a configuration file and returns its `ml_collections.ConfigDict`.

    The text after a colon is the argument of `get_config`. `ConfigError` if anything fails.
    """
    from ml_collections import ConfigDict

    given, colon, rest = value.partition(":")
    path = pathlib.Path(given)
    if not path.is_file():
        raise ConfigError(f"--config={value}: there is no such file")
    try:
        if path.stat().st_size > _LARGEST:
            raise ValueError(f"it has more than {_LARGEST} bytes")
        get_config = runpy.run_path(given, run_name="configuration").get("get_config")
        if not callable(get_config):
            raise ValueError("it has no function get_config")
        config = get_config(*([rest] if colon else []))
        if not isinstance(config, ConfigDict):
            raise TypeError(f"get_config returns {type(config).__name__}")
        return config
    except Exception as error:  # the file may contain anything
        why = f"{type(error).__name__}: {error}"
        raise ConfigError(
            f"--config={value} is not a configuration ({why[:200]}); expected a Python file with a "
            "function get_config() that returns an ml_collections.ConfigDict, such as "
            "configs/base.py"
        ) from error
