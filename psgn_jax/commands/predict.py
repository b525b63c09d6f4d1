"""Predicts points from photos: `psgn predict IMAGE... --out DIR`.

Images are PNG, JPEG, GIF, BMP, TIFF, WebP, PPM, TGA, JPEG 2000 or AVIF files, or folders of them;
convert other formats, such as HEIC, to JPEG. `psgn_jax.prediction.predictor` describes how the
object is found and framed, `psgn_jax.prediction.files` the output. If one image cannot be
processed, the others still are. Exit codes: 0 all images were processed; 1 some failed; 2 all
failed, or an argument is wrong; 5 the disk is full; 130 stopped by Ctrl-C.

In a notebook: `psgn_jax.load()(image)`.
"""

import re
import sys
from collections.abc import Sequence
from typing import Any

from psgn_jax.commands.common import define_network_flags, keep_compiled, network_of
from psgn_jax.config.command_line import Flags
from psgn_jax.config.experiment import ConfigError
from psgn_jax.prediction import masks
from psgn_jax.prediction.draws import FIRST
from psgn_jax.prediction.files import predict_files
from psgn_jax.prediction.formats import DEFAULT_FORMATS
from psgn_jax.prediction.predictor import FRAMES, NORMAL_FORMS, Predictor
from psgn_jax.system.errors import Exit
from psgn_jax.system.files import check_folder
from psgn_jax.system.untrusted import message_line, one_line
from psgn_jax.weights.opening import open_weights

_OPTIONS = (
    "mask", "samples", "seed", "frame", "normal_form", "refine", "first", "surface", "height"
)  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    flags = Flags("psgn predict IMAGE...", __doc__)
    define_network_flags(flags)
    flags.path("out", "out", "Folder for the results.")
    flags.path("mask", None, "File of the mask, or folder of masks.")
    flags.string(
        "mask_from", "auto", f"How to find a mask: {', '.join(masks.METHODS)} or rembg:MODEL."
    )
    flags.list("box", None, "Box around the object, x0,y0,x1,y1 in pixels of the photo.")
    flags.list("point", None, "A pixel of the object, x,y.")
    flags.bool(
        "invert_mask", None, "The masks are white outside the object; default: masks that cover "
        "the border are inverted.",
    )  # fmt: skip
    flags.list(
        "mask_label", None, "The object's label in a mask with several labels: a grey level, an "
        "index of a palette, or a colour R,G,B.",
    )  # fmt: skip
    flags.bool("accept_mask", False, "Use found masks even if the network is not certain.")
    flags.enum("normal_form", "auto", list(NORMAL_FORMS),
               "Move the points onto the ground and scale them to radius 1.")  # fmt: skip
    flags.enum("frame", "auto", list(FRAMES),
               "Crop to the object (place), or use the image as it is (keep).")  # fmt: skip
    flags.bool("refine", True, "Average the cloud with the mirror image's, and fit it to the mask.")
    flags.integer("samples", 1, "Number of clouds per image.")
    flags.enum("first", "zero", list(FIRST), "The first cloud of a network with a random input r: "
               "that of r = 0, or the mean of all draws.")  # fmt: skip
    flags.integer("seed", 0, "Seed of the random input.")
    flags.list("formats", list(DEFAULT_FORMATS), "Formats of the clouds: ply, xyz, obj, npz, glb.")
    flags.bool("surface", False, "Write a closed, textured surface, NAME_surface.glb.")
    flags.float("height", None, "Height of the object in metres, for the surface.",
                lower_bound=1e-6, upper_bound=1e6)  # fmt: skip
    return flags.run(_main, argv)


def _numbers(name: str, texts: list[str] | None, kind: type = float) -> list[Any] | None:
    try:
        return list(map(kind, texts)) if texts else None
    except ValueError:
        what = "an integer, or a colour R,G,B" if kind is int else "numbers"
        raise ConfigError(f"--{name}={','.join(texts or ())}: accepted: {what}") from None


def _with_dashes(message: str) -> str:
    """A message with the flags as one types them."""
    return re.sub(r"\b(box=x|point=x|accept_mask)", r"--\1", message)


def _main(flags: Flags) -> int:
    values = flags.values
    how: Any = {n: values[n].value for n in ("mask_from", "invert_mask", "accept_mask")}
    how |= {name: _numbers(name, values[name].value) for name in ("box", "point")}
    how["mask_label"] = _numbers("mask_label", values.mask_label, int)
    if values["height"].present and not (values.surface and values.height > 0):
        raise ConfigError(f"--height={values.height:g}: accepted: metres > 0, with --surface")
    check_folder(values.out, "--out")

    def opened() -> Predictor:
        keep_compiled()
        predictor = Predictor(open_weights(**network_of(values)))
        predictor.warm_up(values.samples, refine=values.refine, first=values.first)
        return predictor

    done, failed = 0, 0
    options = {name: values[name].value for name in _OPTIONS}
    for path, result in predict_files(
        opened, flags.arguments, values.out, formats=values.formats, mask_options=how, **options
    ):
        if isinstance(result, Exception):
            failed += 1
            name, message = one_line(path), _with_dashes(message_line(result))
            named = message.startswith((f"{name}: ", f"{name} "))
            sys.stderr.write(f"failed: {message if named else f'{name}: {message}'}\n")
            continue
        done += 1
        for warning in result.warnings:
            sys.stderr.write(f"warning: {one_line(path)}: {_with_dashes(one_line(warning))}\n")
        sys.stdout.write(
            f"{one_line(path)}: {len(result.points)} x {result.points.shape[1]} points, mask "
            f"{one_line(result.mask_from)}, {1000 * sum(result.seconds.values()):.0f} ms\n"
        )
        sys.stdout.flush()
    sys.stdout.write(f"results: {one_line(values.out)}\n" if done else "")
    if failed:
        sys.stderr.write(f"{done} of {done + failed} images were processed\n")
    if not failed:
        return Exit.DONE
    return Exit.PARTLY if done else Exit.ERROR
