"""Seconds of the tests by folder, as the table of CONTRIBUTING.md.

python -m pytest -q --durations=0 --durations-min=0 | python tests/helpers/durations.py
"""

import collections
import re
import sys

LINE = re.compile(r"^([0-9.]+)s (?:setup|call|teardown) +tests/(?:(\w+)/)?")


def main():
    seconds = collections.Counter()
    for line in sys.stdin:
        if match := LINE.match(line):
            seconds[f"tests/{match[2]}" if match[2] else "tests"] += float(match[1])
    print("| folder | seconds |\n|---|---|")
    for folder, value in sorted(seconds.items()):
        print(f"| `{folder}` | {value:.0f} |")
    print(f"| **sum** | {seconds.total():.0f} |")


if __name__ == "__main__":
    main()
