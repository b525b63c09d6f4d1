"""Points from photos: `python -m psgn_jax.predict IMAGE... --out DIR`.

The network is that of `--weights=NAME|FILE` or of a run, `--workdir=W`; without either, the default
weights of the package (it has none yet, see `python -m psgn_jax.weights list`).

Images are files of any usual format, or folders of them. How the object is found and framed is
described in `psgn_jax.prediction.predictor`, and the output in `psgn_jax.prediction.files`. One bad
image does not stop the others. Exit code: 0 all images were processed, 1 some failed, 2 all
failed or an argument is wrong.

In a notebook: `psgn_jax.prediction.predictor.Predictor.from_weights()(image)`, with arrays;
`from_workdir(workdir)` is the network of a run.
"""

import sys
from collections.abc import Sequence

from absl import app, flags

from psgn_jax.command_line import (
    define_network_flags,
    exit_on_user_error,
    keep_compiled,
    log_to_terminal,
    parse_flags,
)
from psgn_jax.config import ConfigError
from psgn_jax.data import masks
from psgn_jax.files import check_folder
from psgn_jax.prediction import export
from psgn_jax.prediction.files import predict_files
from psgn_jax.prediction.predictor import NORMAL_FORMS, Predictor
from psgn_jax.untrusted import message_line, one_line
from psgn_jax.weights.opening import open_network


def _main(argv: Sequence[str]) -> None:
    log_to_terminal()
    values = flags.FLAGS
    done, failed = 0, 0
    with exit_on_user_error():
        formats = tuple(values.formats)
        if not formats or not set(formats) <= set(export.FORMATS):
            raise ConfigError(
                f"--formats={','.join(formats)}: accepted: any of {', '.join(export.FORMATS)}"
            )
        if values.invert_mask and not values.mask:
            raise ConfigError("--invert_mask: accepted with --mask=FILE|FOLDER")
        if not argv[1:]:
            raise ConfigError("no image: name files or folders")
        check_folder(values.out, "--out")
        keep_compiled()
        network = open_network(values.workdir, values.weights, values.checkpoint)
        predictor = Predictor.from_run(network)
        predictor.warm_up(values.samples)
        results = predict_files(
            predictor,
            argv[1:],
            values.out,
            mask=values.mask,
            formats=formats,
            samples=values.samples,
            seed=values.seed,
            frame=values.frame,
            mask_from=values.mask_from,
            invert_mask=values.invert_mask,
            normal_form=values.normal_form,
        )
        for path, result in results:
            if isinstance(result, Exception):
                failed += 1
                sys.stderr.write(f"failed: {one_line(path)}: {message_line(result)}\n")
                continue
            done += 1
            for warning in result.warnings:
                sys.stderr.write(f"warning: {one_line(path)}: {warning}\n")
            milliseconds = 1000 * sum(result.seconds.values())
            sys.stdout.write(
                f"{one_line(path)}: {len(result.points)} x {result.points.shape[1]} points, mask "
                f"{result.mask_from}, {milliseconds:.0f} ms\n"
            )
            sys.stdout.flush()
    if failed:
        sys.stderr.write(f"{done} of {done + failed} images were processed, see {values.out}\n")
    sys.exit(0 if not failed else 1 if done else 2)


if __name__ == "__main__":
    define_network_flags()
    flags.DEFINE_string("out", None, "Folder for the results.", required=True)
    flags.DEFINE_string("mask", None, "File of the mask, or folder with one for each image.")
    flags.DEFINE_enum("mask_from", "auto", list(masks.METHODS), "How to find a mask.")
    flags.DEFINE_bool("invert_mask", False, "The given masks are white outside the object.")
    flags.DEFINE_enum(
        "normal_form", "auto", list(NORMAL_FORMS), "Put the points on the ground, with radius 1."
    )
    flags.DEFINE_enum(
        "frame", "auto", ["auto", "place", "keep"], "Crop the object, or keep the image."
    )
    flags.DEFINE_integer("samples", 1, "Clouds for each image.")
    flags.DEFINE_integer("seed", 0, "Seed of the random input.")
    flags.DEFINE_list("formats", list(export.FORMATS), "Formats of the clouds.")
    app.run(_main, flags_parser=parse_flags)
