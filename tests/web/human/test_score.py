import dataclasses
import json

import numpy as np
import pytest
from helpers import weights as helper
from helpers.commands import psgn_each
from helpers.human_study import LEG, LEGS, TOP, corners, table_points, turn
from helpers.refusals import all_refused, check_message, refused
from PIL import Image
from scipy.spatial import ConvexHull

from psgn_jax.config.experiment import ConfigError
from psgn_jax.data.dataset import write_dataset
from psgn_jax.web.human import score
from psgn_jax.web.human.cases import build_study, open_cases, read_answers, read_study
from psgn_jax.web.human.score import sample_union
from psgn_jax.weights.run_folder import Trained

TABLE = [turn(corners(*box)).tolist() for box in (TOP, *LEGS)]


def saved(study_id):
    """The content of a saved file: a model of the table, and none for the second case."""
    first = {"case": "Case 1", "seconds": 90, "done": True, "parts": 2, "solids": TABLE}
    second = {"case": "Case 2", "seconds": 90, "done": False, "parts": 0, "solids": []}
    about = {"format": "psgn human study", "version": 1, "study": study_id}
    return {**about, "cases": [first, second]}


def sampled(*solids, count):
    return sample_union([ConvexHull(corners) for corners in solids], count, 0)


def test_points_are_uniform_also_where_parts_share_faces_or_are_inside_others():
    points, truth = sampled(*TABLE, count=20_000), table_points(20_000)
    for low, high in ((0, 0.3), (0.3, 0.61), (0.61, 0.63), (0.69, 0.71)):
        share = [np.mean((c[:, 2] >= low) & (c[:, 2] < high)) for c in (points, truth)]
        assert share[0] == pytest.approx(share[1], abs=0.012)
    # There are no points under the top where the legs touch it.
    own = (points @ turn(np.eye(3)).T)[:, :2]
    near = np.abs(np.abs(own) - LEG[0][:2]).max(axis=1) < 0.039
    assert not (near & (np.abs(points[:, 2] - 0.62) < 1e-4)).any()
    left, right = (corners((0, y, 0.5), (1, 0.6, 1)) for y in (-0.2, 0.2))
    points = sampled(left, right, corners((0, 0, 0.5), (0.5, 0.5, 0.5)), left, count=30_000)
    assert np.isclose(np.abs(points - [0, 0, 0.5]).max(axis=1), 0.5, atol=1e-4).all()
    # The overlap is neither empty nor counted twice: y is uniform on the top.
    top = points[np.abs(points[:, 2] - 1) < 1e-5]
    counts, _ = np.histogram(top[:, 1], bins=5, range=(-0.5, 0.5))
    assert counts.min() > 0.9 * counts.mean()


@pytest.fixture
def study(study_folder):
    return read_study(study_folder)


def test_files_of_others_are_refused_in_one_line(study, tmp_path):
    file, good = tmp_path / "human.json", json.dumps(saved(study.id))
    with refused(ConfigError, file, "Save all"):
        read_answers(file, study)
    for old, new, *names in (
        (study.id, "0" * 16, study.id),
        ('"version": 1', '"version": 2', "version=2"),
        ('"Case 1"', '"Case 2"', "2 cases"),
        ("90", "-1", "cases[0].seconds=-1", ">= 0"),
        ("90", "NaN", "NaN"),
        (json.dumps(TABLE), json.dumps(TABLE * 161), "805 solids"),
        (json.dumps(TABLE[0][0]), "[1, 1e9, 0]", "[1]=1000000000.0", ">= -20"),
    ):
        assert old in good
        file.write_text(good.replace(old, new, 1))
        with refused(ConfigError, file, *names):
            read_answers(file, study)


def test_other_records_are_refused(study, tmp_path, records):
    known, other = open_cases(study, str(records))
    assert known.model_id == "known"
    write_dataset(tmp_path / "other", {"validation": [other, known]}, source="test")
    with refused(ConfigError, "cameras"):
        open_cases(study, str(tmp_path / "other"))
    with refused(ConfigError, "cases=3", "1 to 2"):
        build_study(str(records), tmp_path, cases=3)


def network(source, **changes):
    config = helper.config(model__fc_points=40, **changes)
    return Trained(config, 7, helper.random_params(config), {}, source, "weights", helper.SOURCES)


@pytest.fixture
def answers(study, tmp_path):
    (tmp_path / "human.json").write_text(json.dumps(saved(study.id)))
    return read_answers(tmp_path / "human.json", study)


@pytest.mark.slow
def test_the_table_is_scored_beside_networks(study, answers, tmp_path):
    networks = score.label_networks([network("runs/cd"), network("runs/emd", model__random_size=3)])
    scored = score.score(study, answers, open_cases(study), networks, num_points=40)
    text = score.write_scores(tmp_path, study, scored, networks, 40)
    numbers = json.loads((tmp_path / "scores.json").read_text())
    assert list(numbers["networks"]) == ["cd", "emd"]
    assert (numbers["cases_modelled"], numbers["cases_in_study"]) == (1, 2)
    (case,) = numbers["cases"]
    keys = ("case", "category", "seconds", "parts")
    assert [case[key] for key in keys] == ["Case 1", "table", 90, 2]
    person, *others = case["metrics"].values()
    assert all(person["emd_radius"] < other["emd_radius"] for other in others)
    assert all(person["cd_sq_radius2"] < 0.1 * other["cd_sq_radius2"] for other in others)
    assert (tmp_path / "scores.md").read_text() == text
    assert "| Case 1 | table | 1.5 | 2 |" in text
    with Image.open(tmp_path / "scores.png") as picture:
        assert min(picture.size) > 200


def test_what_cannot_be_compared_is_refused(study, answers):
    samples = open_cases(study)
    with refused(ConfigError, "points=1024", "40"):
        score.score(study, answers, samples, {"a": network("a")})
    with refused(ConfigError):
        score.score(study, [answers[1], answers[1]], samples, {})
    first, second = answers
    for solid in ([(0, 0, 0)] * 5, []):
        flat = dataclasses.replace(first, solids=(solid,))
        with refused(ConfigError, "Case 1"):
            score.score(study, [flat, second], samples, {}, num_points=100)
    table = [([network("x/a"), network("y/a")], "'a'"), ([network("a")] * 4, "4 networks", "3")]
    all_refused(score.label_networks, ConfigError, table)


def test_the_commands(records, tmp_path):
    out = tmp_path / "study"
    done, failed = psgn_each(
        ["human", f"--data={records}", "--cases=2", f"--out={out}"],
        ["human", "score", out],
        imports=["psgn_jax.web.human.score"],
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{out / 'index.html'}: 2 cases; open it in a browser\n"
    assert (failed.returncode, failed.stdout) == (2, "")
    check_message(failed.stderr, out / "human.json", "Save all")
