"""Shows predictions on a web page, with clouds that can be rotated: `psgn view OUT/*.npz`.

The surfaces of `psgn predict --surface` beside them, NAME_surface.glb, are shown, too.
"""

import contextlib
import pathlib
import sys
from collections.abc import Sequence

from psgn_jax.config.command_line import Flags
from psgn_jax.prediction.formats import read_prediction
from psgn_jax.system.untrusted import one_line, read_json
from psgn_jax.viewing import viewer
from psgn_jax.viewing.surface_file import TexturedMesh, read_surface


def main(argv: Sequence[str] | None = None) -> int:
    flags = Flags("psgn view NPZ... --out=FILE", __doc__)
    flags.path("out", None, "HTML file to write.")
    flags.string("title", "psgn_jax", "Title of the page.")
    return flags.run(_main, argv, wrong_input=(ValueError,))


def _main(flags: Flags) -> None:
    if not flags.values.out.lower().endswith((".html", ".htm")):  # as after `--out out/*.npz`
        raise ValueError(f"--out={flags.values.out}: accepted: a name that ends with .html")
    names = [pathlib.Path(path).stem for path in flags.arguments]
    # Files in different folders may have the same name.
    titles = [n if names.count(n) == 1 else p for p, n in zip(flags.arguments, names, strict=True)]
    cases = (_case(path, title) for path, title in zip(flags.arguments, titles, strict=True))
    pages = viewer.write_pages(flags.values.out, cases, title=flags.values.title)
    for written in sorted(set(pages.values())):
        sys.stdout.write(f"{one_line(written)}\n")


def _case(path: str, title: str) -> viewer.Case:
    arrays = read_prediction(path, viewer.FIELDS)
    start, count = path.removesuffix(".npz"), len(arrays["points"])
    earlier = []
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        earlier = list(read_json(f"{start}.json")["earlier_files"])  # of other predictions
    numbers = [f"_{k}" for k in range(count)] if count > 1 else [""]
    surfaces: list[TexturedMesh | None] = [None] * count
    for k, file in enumerate(pathlib.Path(f"{start}{number}_surface.glb") for number in numbers):
        if file.exists() and file.name not in earlier:
            surfaces[k] = read_surface(file)
    return viewer.case_of(title, arrays, surfaces)
