"""Seconds of the tests by folder, as the table of CONTRIBUTING.md.

    python -m pytest -n 3 --dist=loadfile --junitxml=suite.xml
    python tests/helpers/durations.py suite.xml

The seconds of a folder are the sum over its tests, with their fixtures. With `-n 3` on two cores
they are wall seconds during which other tests ran too.
"""

import collections
import sys
import xml.etree.ElementTree as ElementTree


def folder_of(case):
    """The folder of a test: `tests/losses`, or `tests` for the files directly in it."""
    parts = case.get("classname", "").split(".")
    if parts[0] != "tests":
        return parts[0]  # examples in docstrings
    return "tests" if parts[1].startswith("test_") else f"tests/{parts[1]}"


def main():
    counts, seconds = collections.Counter(), collections.Counter()
    for case in ElementTree.parse(sys.argv[1]).iter("testcase"):
        folder = folder_of(case)
        counts[folder] += 1
        seconds[folder] += float(case.get("time", 0))
    print("| folder | tests | seconds |\n|---|---|---|")
    for folder in sorted(counts):
        print(f"| `{folder}` | {counts[folder]:,} | {seconds[folder]:,.0f} |")


if __name__ == "__main__":
    main()
