"""CD against EMD in training: `python -m psgn_jax.experiments.losses --workdir DIR`.

The study trains a network twice on the same data, in the same order, with the same augmentations,
number of steps and number of true points. One training minimises the squared Chamfer distance (CD),
the other the earth mover's distance (EMD). Both distances are measured for both networks. The paper
also describes two effects, which are measured by two shares:

- A network trained with the CD "tends to scatter a few points in its uncertain area": the share of
  stray points, which are predicted points farther than `FAR` from any true point.
- A network trained with the EMD is "more compact" but "sometimes overly shrinks local structures":
  the share of missed points, which are true points farther than `FAR` from any predicted point.

The runs are `DIR/cd` and `DIR/emd`; `--cd=RUN --emd=RUN` uses two finished runs of one network
instead. `losses.png` shows the samples whose two predictions differ most (by the squared CD between
them). They are chosen to show the difference and are not typical.

Source: Fan, Su, Guibas, CVPR 2017, section 5.5 and its figure of predictions of networks trained
with CD and EMD, which shows an example and no numbers; networks, sizes and measures here are
**ours**.
"""

import pathlib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from absl import flags

from psgn_jax.config import Config, ConfigError, flatten
from psgn_jax.experiments import common, figures
from psgn_jax.experiments.common import Sample
from psgn_jax.losses.by_name import parse_terms
from psgn_jax.metrics.table import Lines

LOSSES: Mapping[str, str] = {"cd": "chamfer_sq_mean", "emd": "emd_mean"}
"""Folder of a training -> the loss that it minimises."""

TITLES = {"cd": "trained with CD", "emd": "trained with EMD"}

FAR = 0.1
"""Distance in radii from which a point counts as stray or missed."""

METRICS = {
    "cd_sq_radius2": "CD squared [radius^2]",
    "emd_radius": "EMD [radius]",
    "cd_l1_radius": "CD-L1 [radius]",
    "fscore": "F-score [%]",
    "cd_sq_pred_to_gt_radius2": "predicted points to truth [radius^2]",
    "cd_sq_gt_to_pred_radius2": "truth to predicted points [radius^2]",
    "stray": "predicted points farther than .1 from the truth [%]",
    "missed": "true points farther than .1 from the prediction [%]",
    "unevenness": "unevenness: std over mean of the distance to the nearest other point",
}
"""Rows of the table; only this study measures the last three."""

COLOURS = {"cd": (70, 130, 180), "emd": (90, 165, 90), "truth": (165, 165, 165)}
"""Colours of the predictions as in the paper, and of the truth."""


def configuration(loss: str, path: str, *, full: bool, steps: int = 0) -> Config:
    """The configuration of `common.recipe` with a loss of `losses.by_name.LOSSES`."""
    # 1,100 steps: both trainings take an estimated 40 minutes on two CPU cores. An EMD requires as
    # many true points as predicted ones.
    changes: dict[str, dict[str, Any]] = {
        "data": {"num_points": 1024},
        "loss": {"name": loss},
        "train": {"eval_every": 0},
    }
    return common.recipe(path, full=full, steps=steps, usual_steps=1_100, changes=changes)


def configs(options: Any) -> Iterable[tuple[str, Config]]:
    """The configurations of both trainings. Finished runs, if given, are checked instead."""
    if bool(options.cd) != bool(options.emd):
        raise ConfigError("--cd, --emd: expected both or neither")
    if options.cd:
        if options.full or options.steps:
            raise ConfigError(
                "--full, --steps apply only to trainings; expected them without --cd and --emd"
            )
        runs(options)
        return []
    path = common.find_data(options.data)
    made = {
        name: configuration(loss, path, full=options.full, steps=options.steps)
        for name, loss in LOSSES.items()
    }
    common.check_data(made["cd"])
    return made.items()


def runs(options: Any) -> dict[str, tuple[pathlib.Path, Config]]:
    """Folders and configurations of both runs, for measuring on the same samples.

    Raises:
      ConfigError: the given finished runs cannot be compared.
    """
    folders = {name: pathlib.Path(getattr(options, name) or options.workdir / name)
               for name in LOSSES}  # fmt: skip
    cd = common.finished_run(folders["cd"], options.data if options.cd else None)
    made = {"cd": cd, "emd": common.finished_run(folders["emd"], like=cd)}
    for name, config in made.items():
        kind = {"cd": "chamfer", "emd": "emd"}[name]
        if not all(term.name.startswith(kind) for term in parse_terms(config.loss.name)):
            raise ConfigError(
                f"--{name}={folders[name]}: loss.name={config.loss.name!r}; expected a run "
                f"{TITLES[name]}"
            )
    flat = {name: flatten(config) for name, config in made.items()}
    for field, value in flat["cd"].items():
        same = field.startswith("model.") or field in ("data.inputs", "data.image_size")
        if same and flat["emd"][field] != value:
            raise ConfigError(
                f"{field}: {value!r} in --cd, {flat['emd'][field]!r} in --emd; expected two runs "
                "of one network"
            )
    return {name: (folders[name], config) for name, config in made.items()}


def own_measures(pred: np.ndarray, gt: np.ndarray) -> dict[str, float]:
    """Stray points, missed points and unevenness of a prediction [n, 3], n > 1; truth [m, 3]."""
    gaps, among = common.squared_distances(pred, gt), common.squared_distances(pred, pred)
    np.fill_diagonal(among, np.inf)
    spacing = np.sqrt(among.min(axis=1))
    return {
        "stray": float(np.mean(gaps.min(axis=1) > FAR**2)),
        "missed": float(np.mean(gaps.min(axis=0) > FAR**2)),
        "unevenness": float(spacing.std() / max(spacing.mean(), 1e-12)),
    }


def apart(a: np.ndarray, b: np.ndarray) -> float:
    """Squared CD of two predictions: the sum of the means in both directions; unit^2."""
    gaps = common.squared_distances(a, b)
    return float(gaps.min(axis=1).mean() + gaps.min(axis=0).mean())


def measure(options: Any) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Measures both runs; returns the numbers and the samples of the figure."""
    own: dict[str, list[dict[str, float]]] = {name: [] for name in LOSSES}
    preds: list[np.ndarray] = []
    cases: dict[int, dict[str, Any]] = {}

    def of_cd(_: int, case: Sample) -> None:
        own["cd"].append(own_measures(case["pred"], case["points"]))
        preds.append(case["pred"])

    def of_emd(number: int, case: Sample) -> None:
        own["emd"].append(own_measures(case["pred"], case["points"]))
        clouds = {"cd": preds[number], "emd": case["pred"]}
        cases[number] = {**case, **clouds, "apart": apart(preds[number], case["pred"])}
        if len(cases) > options.cases:
            del cases[min(cases, key=lambda n: cases[n]["apart"])]

    measured = {
        name: common.measure(folder, config=config, on_sample=of_cd if name == "cd" else of_emd)
        for name, (folder, config) in runs(options).items()
    }
    metrics = {
        name: {
            **run.evaluation.metrics,
            **{key: np.array([sample[key] for sample in own[name]]) for key in own[name][0]},
        }
        for name, run in measured.items()
    }
    document = {
        **common.about(measured["emd"], **{n: r.config.train.steps for n, r in measured.items()}),
        "losses": {name: run.config.loss.name for name, run in measured.items()},
        "far_radius": FAR,
        **compare(metrics),
        "shown": {
            str(n): cases[n]["apart"] for n in sorted(cases, key=lambda n: -cases[n]["apart"])
        },
    }
    for number, case in cases.items():
        lines = [measured["cd"].evaluation.names[number].category or f"sample {number}"]
        for name in LOSSES:
            errors = {"CD": "cd_sq_radius2", "EMD": "emd_radius"}.items()
            shown = (f"{k} {metrics[name][v][number]:.3f}" for k, v in errors if v in metrics[name])
            lines.append(f"by {name.upper()}: {', '.join(shown)}")
        case["label"] = "\n".join(lines)
    return document, [cases[int(number)] for number in document["shown"]]


def compare(metrics: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, Any]:
    """Means of both runs, and differences: trained with EMD minus trained with CD."""
    means = {
        name: {key: common.mean_and_error(values[key])[0] for key in METRICS if key in values}
        for name, values in metrics.items()
    }
    return {"mean_over_samples": means, "emd_minus_cd": common.differences(metrics)}


def table(numbers: Mapping[str, Any]) -> list[Lines]:
    """The comparison."""
    means, changes = numbers["mean_over_samples"], numbers["emd_minus_cd"]
    return [common.table_of_two(means, changes, TITLES, METRICS)]


def panels(case: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Image; both predictions and the truth seen from the camera, then rotated."""
    truth = case["points"][:: max(1, len(case["points"]) // len(case["cd"]))]
    painted: dict[str, Any] = {TITLES[name]: (case[name], COLOURS[name]) for name in LOSSES}
    painted["truth"] = (truth, COLOURS["truth"])
    return figures.clouds(case, painted)


def figure(_: Mapping[str, Any], cases: list[dict[str, Any]]) -> dict[str, Any]:
    """A row for each sample, with its category and the errors of both networks."""
    rows = [panels(case) for case in cases]
    return {"losses": figures.grid(rows, labels=[case["label"] for case in cases])}


STUDY = common.Study(
    "losses",
    configs,
    measure,
    table,
    figure,
    options={"data": None, "full": False, "steps": 0, "cases": 6, "cd": None, "emd": None},
    note="Difference: mean over samples with its standard error. Each network was trained once.",
)

if __name__ == "__main__":
    flags.DEFINE_string("cd", None, "Folder of a finished run trained with CD; default: train one.")
    flags.DEFINE_string("emd", None, "Folder of a finished run trained with EMD.")
    STUDY.main()
