"""The reliability campaign: `python -m tests.campaign --seed=0 --minutes=60 [--part=NAME]`.

Kills the commands, simulates full disks, damages files and supplies hostile input. Counts the
trials after which all requirements were met ("held"). The time is divided equally among the parts.
Writes `<part>.json` for each part and `table.md` into `--out` (default: campaign-<seed>, which must
not exist). docs/reliability.md says which trials the same seed repeats. The exit code is 1 if a
requirement was not met.
"""

import argparse
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))  # as under pytest

from campaign import frame


def main() -> int:
    """Runs the command; returns its exit code."""
    known = frame.parts()
    parser = argparse.ArgumentParser(prog="python -m tests.campaign")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--part", action="append", choices=sorted(known), help="default: all")
    parser.add_argument("--out", type=pathlib.Path)
    arguments = parser.parse_args()
    folder = (arguments.out or pathlib.Path(f"campaign-{arguments.seed}")).absolute()
    if folder.exists():
        parser.error(f"--out={folder} exists")
    folder.mkdir(parents=True)
    chosen = {name: known[name] for name in arguments.part or known}
    table = frame.TABLE_HEAD
    for name, part in chosen.items():
        share = arguments.minutes / len(chosen)
        rows = frame.run_part(name, part, arguments.seed, share, folder)
        sys.stdout.write(rows)
        sys.stdout.flush()
        table += rows
    (folder / "table.md").write_text(table)
    return 0 if frame.all_held(folder) else 1


if __name__ == "__main__":
    sys.exit(main())
