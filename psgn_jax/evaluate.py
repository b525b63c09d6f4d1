"""Evaluates a run, `python -m psgn_jax.evaluate --workdir W`, or weights, `--weights NAME|FILE`.

Without either flag it evaluates the package's default weights. It prints the
table and writes it into the run's folder; for weights, into `eval_<weights>_<split>` in the
current folder. `--report=DIR` also writes a gallery of all samples. Several processes
(`training.launch`) divide the split among themselves. `psgn_jax.tasks.runs` describes the metrics
and the files.
"""

import os
import sys
from collections.abc import Sequence
from typing import Any

from absl import app, flags

from psgn_jax.command_line import (
    define_network_flags,
    flags_only,
    keep_compiled,
    parse_flags,
)
from psgn_jax.config import ConfigError
from psgn_jax.host_memory import keep_freed_memory
from psgn_jax.metrics import table
from psgn_jax.tasks.runs import FRAMES, evaluate_run, report_runs
from psgn_jax.training.launch import place_of
from psgn_jax.training.processes import joined


def _main(argv: Sequence[str]) -> None:
    with flags_only(argv) as values:
        keep_compiled()
        keep_freed_memory()
        if values.compare and not values.report:
            raise ConfigError(f"--compare={values.compare}: accepted only with --report=DIR")
        place = place_of(
            os.environ,
            coordinator=values.coordinator,
            num_processes=values.num_processes,
            process_id=values.process_id,
        )
        if values.report and place is not None:
            raise ConfigError(f"--report={values.report}: accepted only with one process")
        names = ("weights", "checkpoint", "split", "data", "out", "draws", "frame")
        options: dict[str, Any] = {name: values[name].value for name in names}
        with joined(place) as group:
            if values.report:
                workdirs = [values.workdir, *([values.compare] if values.compare else [])]
                result = report_runs(values.report, workdirs, **options)
            else:
                result = evaluate_run(values.workdir, **options)
    if group.is_first:
        sys.stdout.write(table.text(result))


if __name__ == "__main__":
    define_network_flags()
    flags.DEFINE_string("split", None, "Split; default: data.eval_split of the run.")
    flags.DEFINE_string("data", None, "Folder of records in place of those of the run.")
    flags.DEFINE_string(
        "out",
        None,
        "Folder for the tables; default: a folder in the workdir or, for weights, in the current "
        "folder.",
    )
    flags.DEFINE_integer(
        "draws",
        0,
        "Number of predictions per image; the best and the mean of their distances are also "
        "measured; needs a network with a random input; 0 = off.",
        lower_bound=0,
    )
    flags.DEFINE_enum(
        "frame", "keep", list(FRAMES), "keep: images as they are; place: crop and place objects."
    )
    flags.DEFINE_string("report", None, "Folder for a gallery of all samples, as web pages.")
    flags.DEFINE_string("compare", None, "Folder of a second run for the gallery.")
    flags.DEFINE_string("coordinator", None, "HOST:PORT of the first of several processes.")
    flags.DEFINE_integer("num_processes", None, "Number of processes that share the split.")
    flags.DEFINE_integer("process_id", None, "Index of this process, from 0.")
    app.run(_main, flags_parser=parse_flags)
