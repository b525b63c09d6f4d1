import json
import os
import random
import signal

from campaign import forks, frame, kills, load


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


WRITES = """
import pathlib, sys, time
out = pathlib.Path(sys.argv[1])
out.mkdir(exist_ok=True)
for number in range(4):
    time.sleep(0.02)
    if not (out / f"{number}").exists():
        (out / f".{number}").write_text("x" * 1000)
        (out / f".{number}").rename(out / f"{number}")
"""


def test_commands_that_are_forked(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import os, sys\n"
        "assert os.getpgid(0) == os.getpid()\n"
        "if sys.argv[1:] == ['wait']:\n    import time\n    time.sleep(60)\n"
        "print(__name__, sys.argv[1:])\nsys.exit(3)\n"
    )
    log = tmp_path / "log"
    with forks.Forks(["json"]) as server:
        ended = server.run([str(script), "a"], log)
        assert (ended.code, ended.text) == (3, "__main__ ['a']\n")
        assert ended.memory > 1e6
        assert server.run(["-m", "this"], log).text.startswith("The Zen")
        assert server.run([str(script), "wait"], log, timeout=0.2).code == 124
        with server.started([str(script), "wait"], log) as process:
            os.killpg(process.pid, signal.SIGKILL)
            assert process.wait(10) == -signal.SIGKILL


def test_a_command_is_killed_and_compared(tmp_path):
    (tmp_path / "good.py").write_text(WRITES)
    # This one leaves another file after each start that was not its first.
    (tmp_path / "bad.py").write_text(WRITES + "(out / str(time.time())).touch()\n")
    found = {}
    with forks.Forks(["json"]) as server:
        for name in ("good", "bad"):
            command = kills.Command(name, [str(tmp_path / f"{name}.py"), "{out}"])
            killer = kills.Killer(command, server, tmp_path / name, random.Random(0))
            found[name] = kills.kill_all([killer], 0)
    assert [f.tried - f.held for f in found["good"]] == [0] * len(found["good"])
    assert len(found["good"]) > 1
    (finding,) = found["bad"]
    assert finding.held == 0
    assert "without a kill, the second time" in finding.details[0]


def test_the_load_that_a_time_allows():
    # The part starts a moment after its time begins.
    assert load.scaled(299.999, 0.03, 200, 10_000) == 10_000
    assert load.scaled(60, 0.03, 200, 10_000) == 2_000
    assert load.scaled(1, 0.03, 200, 10_000) == 200
