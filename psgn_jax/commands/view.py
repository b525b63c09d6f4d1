"""Shows predictions on a web page, with clouds that can be rotated: `psgn view OUT/*.npz`."""

import argparse
import pathlib
import sys
from collections.abc import Sequence

from psgn_jax.system.untrusted import message_line, one_line
from psgn_jax.viewing import page
from psgn_jax.viewing.predictions import read_prediction


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(prog="psgn view", description=__doc__)
    parser.add_argument("predictions", nargs="+", metavar="NPZ", help="files of psgn predict")
    parser.add_argument("--out", required=True, help="HTML file to write")
    parser.add_argument("--title", default="psgn_jax")
    arguments = parser.parse_args(argv)
    try:
        names = [pathlib.Path(path).stem for path in arguments.predictions]
        cases = []
        for path, name in zip(arguments.predictions, names, strict=True):
            arrays = read_prediction(path, ("points", "colours", "branch", "image"))
            # Files in different folders may have the same name, as predictions of one photo.
            title = name if names.count(name) == 1 else path
            num_fc = int((arrays["branch"] == 0).sum())
            cases.append(
                page.Case(
                    title,
                    arrays["image"],
                    arrays["points"],
                    num_fc=num_fc,
                    colours=arrays["colours"],
                )
            )
        pages = page.write_pages(arguments.out, cases, title=arguments.title)
    except (OSError, ValueError) as error:
        sys.stderr.write(f"error: {message_line(error)}\n")
        return 2
    for path in sorted(set(pages.values())):
        sys.stdout.write(f"{one_line(path)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
