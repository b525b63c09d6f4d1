"""The paper's study of human ability: `psgn human --data=RECORDS --out=STUDY`.

    psgn human --data=RECORDS --cases=16 --out=study
    psgn human score study --workdir=RUN [--workdir=RUN2]

The first command writes a page, `study/index.html`; open it in a browser as a file. There, a person
models the object of each image from boxes, cylinders, cones, spheres and prisms, and saves all
models as `human.json`. The page sends no requests and does not contain the objects' true points.

The second command compares the models in `study/human.json` (or `--answers=FILE`) with networks. It
writes the CD and EMD of each case to `scores.md` and `scores.json`, and the paper's figure to
`scores.png`. It needs the extra `experiments`.
"""

import pathlib
import sys
from collections.abc import Sequence
from typing import Any

from psgn_jax.commands.common import keep_compiled
from psgn_jax.config.command_line import Flags
from psgn_jax.config.experiment import ConfigError
from psgn_jax.system.files import check_folder
from psgn_jax.web.human import cases as lib


def _build(values: Any) -> None:
    for name in ("data", "out"):
        if not getattr(values, name):
            raise ConfigError(f"--{name} is missing; expected --data=RECORDS --out=STUDY")
    page = lib.build_study(values.data, values.out, split=values.split, cases=values.cases)
    sys.stdout.write(f"{page}: {values.cases} cases; open it in a browser\n")


def _score(folder: pathlib.Path, values: Any) -> None:
    study = lib.read_study(folder)
    answers = lib.read_answers(values.answers or folder / lib.ANSWERS_FILE, study)
    if not values.workdir and not values.weights:
        raise ConfigError("--workdir is missing; expected --workdir=RUN or --weights=NAME")
    out = pathlib.Path(values.out or folder)
    check_folder(out, "--out")
    keep_compiled()
    # Here, because the page and the errors above need no JAX.
    from psgn_jax.studies import figures
    from psgn_jax.web.human import score
    from psgn_jax.weights.opening import open_weights

    figures.check_installed()
    samples = lib.open_cases(study, values.data)
    how = {"argument": "workdir"}
    runs = [open_weights(folder, values.checkpoint, **how) for folder in values.workdir]
    checkpoint = "best" if runs else values.checkpoint  # refused if there are only weights
    runs += [open_weights(name, checkpoint) for name in values.weights]
    networks = score.label_networks(runs)
    scored = score.score(study, answers, samples, networks, num_points=values.points)
    text = score.write_scores(out, study, scored, networks, values.points)
    sys.stdout.write(f"{text}\nwritten to {out}\n")


def main(argv: Sequence[str] | None = None) -> int:
    flags = Flags("psgn human [ARGUMENT...]", __doc__)
    flags.path("data", "", "Folder of records; with `score`: only if it was moved.")
    flags.path("out", "", "Folder for the page; with `score`: for tables and figure.")
    flags.string("split", "validation", "Split of the records.")
    flags.integer("cases", 16, "Number of cases, evenly spaced over the split.")
    flags.path("answers", "", "File saved by the page; default: STUDY/human.json.")
    for name, what in (
        ("workdir", "Folder of a run to compare with; repeatable."),
        ("weights", "Name or file of weights; repeatable."),
    ):
        flags.path(name, [], what, "multi_string")
    flags.enum("checkpoint", "best", ["best", "last"], "Checkpoint of the runs.")
    flags.integer("points", 1024, "Points of each cloud.", lower_bound=16)
    return flags.run(_main, argv)


def _main(flags: Flags) -> None:
    match flags.arguments:
        case []:
            _build(flags.values)
        case ["score", study]:
            _score(pathlib.Path(study), flags.values)
        case arguments:
            raise ConfigError(f"{' '.join(arguments)}: expected no arguments, or `score STUDY`")
