import json

from campaign import frame


def test_a_part_is_seeded_counted_and_written(tmp_path):
    drawn = []

    def part(rng, deadline, folder):
        drawn.append(rng.random())
        finding = frame.Finding("a kind")
        finding.add()
        finding.add("two\nlines")
        return [finding]

    rows = frame.run_part("one", part, 3, 0.1, tmp_path / "a")
    frame.run_part("one", part, 3, 0.1, tmp_path / "b")
    frame.run_part("one", part, 4, 0.1, tmp_path / "c")
    assert drawn[0] == drawn[1] != drawn[2]
    assert rows == "| one | a kind | 2 | 1 |\n"
    document = json.loads((tmp_path / "a/one.json").read_text())
    assert document["findings"][0]["details"] == ["two lines"]
    assert not frame.all_held(tmp_path / "a")


def test_a_part_that_raises_has_not_held(tmp_path):
    def part(rng, deadline, folder):
        raise RuntimeError("no")

    frame.run_part("one", part, 0, 0.1, tmp_path)
    assert not frame.all_held(tmp_path)
    (finding,) = json.loads((tmp_path / "one.json").read_text())["findings"]
    assert "RuntimeError: no" in finding["details"][0]


def test_commands_and_their_one_line(tmp_path):
    log = tmp_path / "log"
    good = frame.run(["-c", "import sys; sys.exit('error: no')"], log)
    assert (good.code, good.text) == (1, "error: no\n")
    assert frame.not_one_line(good, 1) == ""
    assert "exit code 1" in frame.not_one_line(good)
    assert frame.run(["-c", "import time; time.sleep(60)"], log, timeout=0.2).code == 124


def test_every_part_is_found():
    assert all(callable(part) for part in frame.parts().values())
