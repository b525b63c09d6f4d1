"""Evaluates a run, `psgn evaluate --workdir W`, or weights, `--weights NAME|FILE`.

The command prints a table and writes it to the run's folder; for weights, to
`eval_<weights>_<split>` in the current folder. `--report=DIR` also writes a gallery of all samples.
`--baselines` writes the table of `evaluation.baselines` instead. Several processes
(`system.distributed`) share the split. `psgn_jax.tasks.run` describes metrics and files.
"""

import dataclasses
import sys
from collections.abc import Sequence
from typing import Any

from psgn_jax.commands.common import (
    define_network_flags,
    define_process_flags,
    joined,
    keep_compiled,
    network_of,
)
from psgn_jax.commands.default_data import ensure_default_data
from psgn_jax.config.command_line import Flags
from psgn_jax.config.data import DataConfig
from psgn_jax.config.experiment import ConfigError, EvalConfig, check_paths, require_points_task
from psgn_jax.data.manifest import load_manifest
from psgn_jax.evaluation import baselines, table
from psgn_jax.models import networks
from psgn_jax.system import distributed
from psgn_jax.system.cpu import keep_freed_memory
from psgn_jax.system.files import check_folder, write_atomic
from psgn_jax.tasks.run import FRAMES, evaluate_run, output_folder, report_runs
from psgn_jax.weights.opening import open_weights
from psgn_jax.weights.run_folder import Trained

_OPTIONS = ("split", "out", "draws", "frame", "refine")


def open_with_records(
    source: str, checkpoint: str = "best", data: str | None = None,
    *, training: bool = False, argument: str = "weights",
) -> Trained:  # fmt: skip
    """Opens a network and checks that the records for its evaluation exist.

    Args:
      data: folders that replace the records of the configuration.
      training: whether the records for training are needed, too.
    """
    run = open_weights(source, checkpoint, argument=argument)
    config = run.config
    if data is not None:
        named = dataclasses.replace(config.data, path=data, eval_path="")
        config = dataclasses.replace(config, data=named)
    check_paths(config, training=training, hint="--data names others")
    ensure_default_data(config, training=training)
    return run._replace(config=config)


def _baselines(run: Trained, split: str | None, out: str | None) -> str:
    require_points_task(run.config, "--baselines")
    split = split or run.config.data.eval_split
    folder = output_folder(run, out, "baselines", split)
    rows, models = baselines.measure(run.config, run.params, split)
    table_text = baselines.text(rows, models, networks.build(run.config.model).num_points)
    write_atomic(folder / "baselines.txt", table_text)
    origin = {run.source_kind: run.source, "step": run.step, "split": split}
    write_atomic(folder / "baselines.json", baselines.json_text(rows, models, **origin))
    return table_text


def main(argv: Sequence[str] | None = None) -> int:
    flags = Flags("psgn evaluate", __doc__)
    define_network_flags(flags)
    flags.string("split", None, "Split; default: data.eval_split of the run.")
    flags.path("data", None, "Folder of records in place of those of the run.")
    flags.path(
        "out", None, "Folder for the tables; default: a folder in the workdir, or for weights in "
        "the current folder.",
    )  # fmt: skip
    flags.integer(
        "draws", 0, "Also measure the best and the mean of so many predictions per image; needs a "
        "network with a random input; 0 = off.", lower_bound=0,
    )  # fmt: skip
    flags.enum(
        "frame", "keep", list(FRAMES), "keep: images as they are; place: crop and place as photos."
    )
    flags.bool(
        "refine", None, "Measure clouds as psgn predict writes them: averaged with the mirror "
        "image's and fitted to the mask; default: eval.refine of the run.",
    )  # fmt: skip
    flags.bool("baselines", False, "Compare the network with simple baselines instead.")
    flags.path("report", None, "Folder for a gallery of all samples, as web pages.")
    flags.path("compare", None, "Folder of a second run for the gallery.")
    define_process_flags(flags)
    return flags.run(_main, argv)


def _main(flags: Flags) -> None:
    values = flags.values
    # Report wrong folders before a network is read or records are rendered.
    if values.out is not None:
        check_folder(values.out, "--out")
    if values.data:
        for folder in DataConfig(path=values.data).folders:
            load_manifest(folder)
    keep_compiled()
    keep_freed_memory()
    if values.compare and not values.report:
        raise ConfigError(f"--compare={values.compare}: accepted only with --report=DIR")
    others = flags.given("report", "draws", "num_processes", "refine", "frame")
    if values.baselines and others:
        raise ConfigError(f"{others[0]}: not accepted with --baselines")
    if values.report is not None:
        check_folder(values.report, "--report")
    options: dict[str, Any] = {n: values[n].value for n in _OPTIONS}
    # Baselines are computed outside `shard_map`, where oneDNN needs a single device.
    with joined(values, 1 if values.baselines else EvalConfig().batch_size) as first:
        if values.report and distributed.index_and_count()[1] > 1:
            raise ConfigError(f"--report={values.report}: accepted only with one process")
        how, compared = {"data": values.data, **network_of(values)}, values.compare
        runs = [open_with_records(**how, training=values.baselines)]
        if compared:
            runs.append(open_with_records(**how | {"source": compared, "argument": "compare"}))
        if values.baselines:
            sys.stdout.write(_baselines(runs[0], values.split, values.out))
            return
        if values.report:
            result = report_runs(values.report, runs, **options)
        else:
            result = evaluate_run(runs[0], **options)
    if first:
        sys.stdout.write(table.text(result))
