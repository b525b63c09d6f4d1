"""CPU seconds of the tests by folder, as the table of CONTRIBUTING.md.

    python tests/helpers/durations.py [FOLDER ...]

Runs the tests of each folder of `tests/` (`.` = the files directly in it) in a separate process.
CPU seconds include child processes and depend little on other work of the machine.
"""

import pathlib
import re
import resource
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]


def measure(folder):
    """Number of tests and CPU seconds of a folder."""
    path = ROOT / "tests" / folder
    targets = [path] if folder != "." else sorted(path.glob("test_*.py"))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *map(str, targets)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.stderr.write(done.stdout[-4000:])
    tests = sum(map(int, re.findall(r"(\d+) (?:passed|failed|skipped)", done.stdout)))
    return tests, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main():
    has_tests = [p.parent for p in (ROOT / "tests").rglob("test_*.py")]
    known = sorted({p.relative_to(ROOT / "tests").parts[:1] for p in has_tests})
    print("| folder | tests | CPU seconds |\n|---|---|---|")
    for folder in sys.argv[1:] or [parts[0] if parts else "." for parts in known]:
        tests, seconds = measure(folder)
        name = "tests/*.py" if folder == "." else f"tests/{folder}"
        print(f"| `{name}` | {tests} | {seconds:.0f} |", flush=True)


if __name__ == "__main__":
    main()
