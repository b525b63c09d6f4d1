"""Kills of fine-tuning, prediction, evaluation and studies, at random moments.

If the same command is started again, it must give the results of an undisturbed run: bit-identical
parameters, the same clouds and the same tables.
"""

import json
import pathlib
import random
from collections.abc import Mapping

import numpy as np
from PIL import Image

from campaign import frame, kills, runs, small_study
from campaign.forks import TRAINING, Forks

IMPORTS = (
    *TRAINING, "psgn_jax.tasks.runs", "psgn_jax.prediction.files", "psgn_jax.weights.opening",
    "psgn_jax.experiments.figures",
)  # fmt: skip
TIMES = ("seconds", "samples_per_second", "seconds_per_sample")
IMAGES = 4


def of_run(folder: pathlib.Path) -> dict[str, object]:
    """Arrays of the last checkpoint, metrics and scores of a run."""
    last = runs.last_checkpoint(folder)
    if last is None:
        return {}
    arrays: dict[str, object] = {name: leaf.tobytes() for name, leaf in last.leaves.items()}
    scores = (folder / "checkpoints" / "scores.json").read_text()
    return arrays | {"": last.step, "metrics": runs.metric_lines(folder), "scores": scores}


def of_files(folder: pathlib.Path) -> dict[str, object]:
    """The contents of all files, without times; archives are represented by their arrays."""
    return {
        name: _content(folder / name)
        for name in kills.files_of(folder)
        if not pathlib.Path(name).name.startswith(".")
    }


def _content(path: pathlib.Path) -> object:
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name].tobytes() for name in arrays.files}
    if path.suffix != ".json":
        return path.read_bytes()
    tree = json.loads(path.read_text())
    return {k: v for k, v in tree.items() if k not in TIMES} if isinstance(tree, dict) else tree


def of_study(folder: pathlib.Path) -> Mapping[str, object]:
    """The results of a study and its runs."""
    results = {p.name: p.read_bytes() for p in folder.glob("small.*")}
    parts = {name: of_run(folder / name) for name in small_study.NAMES}
    return {**results, **parts} if results and all(parts.values()) else {}


def _photos(folder: pathlib.Path) -> pathlib.Path:
    folder.mkdir()
    for number in range(IMAGES):
        picture = Image.new("RGB", (80, 60), (191, 191, 191))
        picture.paste((200, 60, 20 * number), (20, 15, 50 + number, 45))
        picture.save(folder / f"{number}.png")
    return folder


def part(rng: random.Random, deadline: float, folder: pathlib.Path) -> list[frame.Finding]:
    """Kills each of the commands in turn."""
    records = runs.make_records(folder / "records")
    base = folder / "base"
    photos = _photos(folder / "photos")
    run = f"--workdir={base}"
    with Forks(IMPORTS, **runs.quick(folder)) as forks:
        ended = forks.run(runs.training(records, base), folder / "log")
        if ended.code:
            return [frame.Finding("an undisturbed training", 1, 0, [ended.text[-2000:]])]
        tuning = runs.training(records, pathlib.Path("{out}"), train__init=base, train__steps=20)
        study = ["tests/campaign/small_study.py", "--workdir={out}", f"--data={records}"]
        commands = (
            kills.Command("fine-tuning", tuning, of_run),
            kills.Command(
                "prediction", ["-m", "psgn_jax.predict", str(photos), run, "--out={out}"], of_files
            ),
            kills.Command(
                "evaluation",
                ["-m", "psgn_jax.evaluate", run, "--out={out}/t", "--report={out}/g"],
                of_files,
            ),
            kills.Command("a study", study, of_study),
        )
        killers = [
            kills.Killer(command, forks, folder / command.name.replace(" ", "_"), rng)
            for command in commands
        ]
        return kills.kill_all(killers, deadline)
