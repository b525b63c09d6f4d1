"""Scores: files that are not trusted, tables and figures, and the commands."""

import copy
import dataclasses
import json
import os
import pathlib
import subprocess
import sys

import pytest
from helpers import weights as helper
from helpers.human_study import LEG, TOP, TURN
from PIL import Image

from psgn_jax.config import ConfigError
from psgn_jax.data.dataset import write_dataset
from psgn_jax.human import score
from psgn_jax.human.answers import AnswersError, read_answers
from psgn_jax.human.build import MODULES, build_study, script
from psgn_jax.human.records import open_cases, read_study
from psgn_jax.training.run_folder import Run

ROOT = pathlib.Path(__file__).resolve().parents[2]
OUTLINE = [[-0.5, -0.5], [0.5, -0.5], [0, 0.5]]


def box(at, size, **fields):
    part = {"kind": "box", "at": list(at), "size": list(size), "turn": [0, 0, 0]}
    return {**part, "mirror": "", "taper": 1, "sides": 3, "outline": [], **fields}


def saved(study_id, parts=None):
    """The content of a saved file: a model of the table, and none for the second case."""
    own = [box(*TOP), box(*LEG, mirror="xy")] if parts is None else parts
    case = {"seconds": 90, "done": True, "turn": TURN, "x": 0, "y": 0}
    return {
        "format": "psgn human study",
        "version": 1,
        "study": study_id,
        "cases": [
            {"case": "Case 1", **case, "parts": own},
            {"case": "Case 2", **case, "done": False, "parts": []},
        ],
    }


def network(source, **changes):
    config = helper.config(model__fc_points=40, **changes)
    return Run(config, 7, helper.random_params(config), {}, source, "weights", helper.SOURCES)


@pytest.fixture
def study(study_folder):
    return read_study(study_folder)


@pytest.fixture
def answers(study, tmp_path):
    (tmp_path / "human.json").write_text(json.dumps(saved(study.id)))
    return read_answers(tmp_path / "human.json", study)


# --- files that are not trusted ----------------------------------------------------------------


def changed(document, path, value):
    document = copy.deepcopy(document)
    node = document
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    return document


FIRST = ("cases", 0, "parts", 0)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("study",), "0" * 16, "expected '"),
        (("format",), "other", "format='other'"),
        (("version",), 2, "version=2"),
        (("more",), 1, "more is not a field"),
        (("cases",), [], "expected the cases Case 1 to Case 2"),
        (("cases", 0, "case"), "Case 2", "each once"),
        (("cases", 0, "turn"), 1e9, r"cases\[0\].turn=1000000000.0: accepted: a number >= -360"),
        (("cases", 0, "seconds"), -1, "seconds=-1"),
        (("cases", 0, "parts"), {}, r"cases\[0\].parts=\{\}: accepted: a tuple"),
        (("cases", 0, "parts"), [box(*TOP)] * 201, "201 parts, expected at most 200"),
        ((*FIRST, "kind"), "torus", "kind='torus'"),
        ((*FIRST, "size"), [1, 1, 0], r"size\[2\]=0"),
        ((*FIRST, "size"), [1, 1], "a tuple of 3"),
        ((*FIRST, "at", 0), "1e400", "accepted: a number"),
        ((*FIRST, "outline"), OUTLINE, "a box with an outline"),
        (FIRST, box(*TOP, kind="outline"), "0 corners, expected 3 to 64"),
        (FIRST, box(*TOP, kind="outline", outline=OUTLINE[::-1]), "counter-clockwise"),
        (FIRST, box(*TOP, kind="outline", outline=OUTLINE * 22), "66 corners"),
        (FIRST, box(*TOP, kind="outline", outline=[[0, 0], [9, 0], [0, 1]]), r"outline\[1\]\[0\]"),
        (FIRST, None, r"parts\[0\]=None"),
    ],
)
def test_files_out_of_bounds_end_in_one_line(study, tmp_path, path, value, message):
    file = tmp_path / "human.json"
    file.write_text(json.dumps(changed(saved(study.id), path, value)))
    with pytest.raises(AnswersError, match=message) as caught:
        read_answers(file, study)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(file))
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "Expecting value"),
        (b"[1, 2]", "accepted: a section"),
        (b"[" * 100_000, "nested more than 32 deep"),
        (b'{"version": NaN}', "NaN is not JSON"),
        (b"\xff\xfe\x00", "decode"),
        (b"[" + b"1," * 11_000_000 + b"1]", "expected at most 20000000"),
    ],
)
def test_files_of_another_kind_end_in_one_line(study, tmp_path, content, message):
    file = tmp_path / "human.json"
    file.write_bytes(content)
    with pytest.raises(AnswersError, match=message):
        read_answers(file, study)


def test_a_missing_file_says_what_to_do(study, tmp_path):
    with pytest.raises(AnswersError, match="press `Save all` in the page"):
        read_answers(tmp_path / "human.json", study)


def test_a_folder_without_a_study_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"study.json: no such file; expected a folder of `psgn"):
        read_study(tmp_path)
    (tmp_path / "study.json").write_text('{"format": 1}')
    with pytest.raises(ConfigError, match=r"study.json is damaged \(format=1: .*write the study"):
        read_study(tmp_path)


def test_other_records_are_refused(study, tmp_path, records):
    known, other = open_cases(study, str(records))
    assert known.model_id == "known"
    write_dataset(tmp_path / "other", {"validation": [other, known]}, source="test")
    with pytest.raises(ConfigError, match="images or cameras differ from those of the study"):
        open_cases(study, str(tmp_path / "other"))
    write_dataset(tmp_path / "few", {"validation": [known]}, source="test")
    with pytest.raises(ConfigError, match="has 1 records, Case 2 is number 1"):
        open_cases(study, str(tmp_path / "few"))


# --- scores ------------------------------------------------------------------------------------


def test_the_table_is_scored_beside_networks(study, answers, tmp_path):
    runs = [network("runs/cd"), network("runs/emd", model__random_size=3)]
    networks = score.label_networks(runs)
    scored = score.score(study, answers, open_cases(study), networks, num_points=40)
    text = score.write_scores(tmp_path, study, scored, networks)
    numbers = json.loads((tmp_path / "scores.json").read_text())
    assert list(numbers["networks"]) == ["cd", "emd"]
    assert (numbers["cases_modelled"], numbers["cases_in_study"]) == (1, 2)
    assert numbers["alignment"] == "none"
    (case,) = numbers["cases"]
    assert (case["case"], case["category"], case["seconds"], case["parts"]) == (
        "Case 1", "table", 90, 2
    )  # fmt: skip
    person, *others = case["metrics"].values()
    assert all(person["emd_radius"] < other["emd_radius"] for other in others)
    assert all(person["cd_sq_radius2"] < 0.1 * other["cd_sq_radius2"] for other in others)
    assert numbers["worst_of_person"] == {"cd_sq_radius2": ["Case 1"], "emd_radius": ["Case 1"]}
    assert (tmp_path / "scores.md").read_text() == text
    assert "| Case 1 | table | 1.5 | 2 |" in text
    for name in ("scores.png", "worst.png"):
        with Image.open(tmp_path / name) as picture:
            assert min(picture.size) > 200


def test_what_cannot_be_compared_is_refused(study, answers, records):
    samples = open_cases(study)
    with pytest.raises(ConfigError, match="predicts 40 points, --points=1024; expected the same"):
        score.score(study, answers, samples, {"a": network("a")})
    with pytest.raises(
        ConfigError, match=r"--points=9000: a record has 4096 points; accepted|8192"
    ):
        score.score(study, answers, samples, {}, num_points=9000)
    empty = [answers[1], answers[1]]
    with pytest.raises(AnswersError, match="no case has a model yet"):
        score.score(study, empty, samples, {})
    with pytest.raises(ConfigError, match="the name 'a' is already used"):
        score.label_networks([network("x/a"), network("y/a")])
    with pytest.raises(ConfigError, match="4 networks: accepted: at most 3"):
        score.label_networks([network("a")] * 4)


def test_the_worst_cases_come_first(study, answers):
    sample = open_cases(study)[0]
    cases = [
        score.Scored(
            dataclasses.replace(answers[0], case=f"Case {i}"),
            sample,
            {},
            {"person": {"emd_radius": value, "cd_sq_radius2": 1 - value}},
        )
        for i, value in enumerate((0.1, 0.4, 0.2, 0.3))
    ]
    assert score.worst_cases(cases, "emd_radius") == ["Case 1", "Case 3", "Case 2"]
    assert score.worst_cases(cases, "cd_sq_radius2", 1) == ["Case 0"]


# --- the page and the command ------------------------------------------------------------------


def test_every_module_is_in_the_page():
    static = ROOT / "psgn_jax" / "human" / "static"
    assert {path.stem for path in static.glob("*.js")} == set(MODULES)
    text = script()
    assert "\nimport " not in text
    assert "\nexport " not in text
    assert "</script" not in text


@pytest.mark.parametrize("cases", [0, 3, 500])
def test_a_wrong_number_of_cases(records, tmp_path, cases):
    with pytest.raises(
        ConfigError, match=f"--cases={cases}: the split has 2 records; accepted: 1 to 2"
    ):
        build_study(str(records), tmp_path, cases=cases)


def test_the_commands(records, tmp_path):
    environment = os.environ | {"JAX_PLATFORMS": "cpu", "PSGN_CACHE": str(tmp_path / "cache")}

    def run(*arguments):
        command = [sys.executable, "-m", "psgn_jax.cli", "human", *map(str, arguments)]
        return subprocess.run(
            command, capture_output=True, text=True, cwd=ROOT, env=environment, timeout=300
        )

    out = tmp_path / "study"
    done = run(f"--data={records}", "--cases=2", f"--out={out}")
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{out / 'index.html'}: 2 cases; open it in a browser\n"
    for arguments, message in [
        (["score", out], f"error: {out / 'human.json'}: no such file; press `Save all`"),
        (["skore", out], "expected no arguments, or `score STUDY`"),
    ]:
        done = run(*arguments)
        assert (done.returncode, done.stdout) == (2, "")
        (line,) = done.stderr.splitlines()
        assert message in line
