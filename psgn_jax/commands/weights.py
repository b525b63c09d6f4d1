"""Trained weights as files: `psgn weights COMMAND`.

    psgn weights list [NAME|FILE ...]
    psgn weights export --workdir=RUN --out=FILE.safetensors
        [--checkpoint=best|last] [--ema|--noema] [--dtype=float16|float32]
        [--sources=sources.json,more.json] [--samples_before=N]

`list` shows network, data and licences of weights, by default of those in the package. The model
card has their metrics; `psgn evaluate` measures them. `export` writes a checkpoint of a run as a
file, for `--weights=FILE` of the other commands and for `--config.train.init=FILE`. Exit codes: 0
done, 2 error, 5 disk full.
"""

import pathlib
import sys
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from psgn_jax.config.command_line import Flags
from psgn_jax.config.experiment import ConfigError
from psgn_jax.models import networks
from psgn_jax.prediction import mask_networks
from psgn_jax.system.untrusted import one_line
from psgn_jax.weights.file import (
    DTYPES,
    figures_of,
    read_sources,
    read_weights,
    source_text,
    write_weights,
)
from psgn_jax.weights.opening import DEFAULT, origins_of, shipped, weights_path
from psgn_jax.weights.run_folder import Trained, open_run


def main(argv: Sequence[str] | None = None) -> int:
    flags = Flags("psgn weights COMMAND [NAME|FILE...]", __doc__)
    flags.path("workdir", "", "export: folder of the run.")
    flags.path("out", "", "export: file to be written, *.safetensors.")
    flags.enum("checkpoint", "best", ["best", "last"], "export: checkpoint of the run.")
    flags.bool("ema", True, "export: the averaged parameters, if the run has them.")
    flags.enum("dtype", "float16", list(DTYPES), "export: type of the numbers.")
    flags.path(
        "sources", [], "export: JSON files that list data and licences; the sources of the "
        "networks from which the run started are added.", "list",
    )  # fmt: skip
    flags.integer(
        "samples_before", 0, "export: training samples seen by the networks from which the run "
        "started.", lower_bound=0,
    )  # fmt: skip
    return flags.run(_main, argv)


def _main(flags: Flags) -> None:
    command, *names = flags.arguments
    if command == "list":
        if given := flags.given(*flags.values):
            raise ConfigError(f"{given[0]}: accepted only by `psgn weights export`")
        sys.stdout.write(_list(names))
    elif command == "export" and not names:
        sys.stdout.write(_export(flags.values))
    else:
        raise ConfigError(f"{' '.join(flags.arguments)}: expected `list [NAME|FILE...]`, `export`")


def _list(names: Sequence[str]) -> str:
    texts = []
    for name in names or shipped():
        path = weights_path(name)
        texts.append(describe(read_weights(path), path))
    if not names:
        size = mask_networks.FILE.stat().st_size / 1e6
        about = {
            "network": f"finds the object in a photo; ONNX, {size:.1f} MB",
            "licences": source_text(mask_networks.SOURCE),
        }
        texts.append(_section(mask_networks.FILE.stem, about))
    return "\n".join(texts)


def _export(values: Any) -> str:
    for name in ("workdir", "out"):
        if not values[name].value:
            raise ConfigError(f"--{name} is missing; expected --workdir=RUN --out=FILE")
    rows = [row for path in values.sources for row in read_sources(path)]
    run = open_run(values.workdir, values.checkpoint, averaged=values.ema)
    # The scores are those of the averaged parameters, if there are any.
    averaged = values.ema and run.config.optim.ema_decay > 0
    if run.config.optim.ema_decay > 0 and not averaged:
        run = run._replace(scores={})
    (data, sources), before = origins_of(run.config, rows), values.samples_before
    figures = figures_of(run, data, averaged=averaged, samples_before=before)
    run = run._replace(figures=figures, sources=sources, dtype=values.dtype)
    write_weights(values.out, run)
    return describe(run, pathlib.Path(values.out))


def describe(weights: Trained, path: pathlib.Path) -> str:
    config, figures = weights.config, weights.figures
    branches = networks.build(config.model).branches
    height, width = config.data.image_size
    rows = {
        "network": f"{config.model.name}, {figures['parameters'] / 1e6:.2f} M parameters, "
        f"{weights.dtype}, {path.stat().st_size / 1e6:.1f} MB; {'+'.join(config.data.inputs)} of "
        f"{height}x{width} pixels to {len(branches.fc) + len(branches.deconv)} points",
        "training": f"{figures['samples_seen']:,} samples seen"
        + (", averaged parameters" if figures.get("averaged") else ""),
        "data": ", ".join(map(_data, figures["data"])) or "not stated",
        "licences": "; ".join(map(source_text, weights.sources)) or "not stated",
    }
    is_default = path == shipped().get(DEFAULT)
    return _section(path.stem + " (default)" * is_default, rows)


def _section(title: str, rows: Mapping[str, str]) -> str:
    wrapper = textwrap.TextWrapper(
        100, subsequent_indent=12 * " ", break_long_words=False, break_on_hyphens=False
    )
    lines = [one_line(title)]
    for name, text in rows.items():
        lines += wrapper.wrap(one_line(f"  {name:9} {text}"))
    return "".join(f"{line}\n" for line in lines)


def _data(row: Mapping[str, Any]) -> str:
    samples = f" ({row['samples']} samples)" if "samples" in row else ""
    return f"{row.get('name', '?')}{samples}"
