"""Estimates of the hardware that large trainings and their data need, for docs/scaling.md.

    python tests/bench/scaling.py [--step_ms 6] [--models 50000] [--views 24] [--gpus 1 8 64]

Measured constants are flags, whose help names the command that measures them. Sizes of parameters
and of samples in memory are computed from the network and the formats.
"""

import argparse

BATCH, SIDES, POINTS = 32, (192, 256), 16_384
PROCESS_GPUS = 8
"""Accelerators of one machine."""


def parameter_bytes():
    """Bytes of the parameters of the full two-branch network."""
    import jax

    from psgn_jax.config import parse
    from psgn_jax.models import point_out_net
    from psgn_jax.training import state

    config = parse({})
    tx = state.optimizer(config.optim, config.train.steps)
    model = point_out_net.build(config.model)
    shapes = jax.eval_shape(lambda: state.create(config, model, tx)).params
    return sum(4 * leaf.size for leaf in jax.tree.leaves(shapes))


def training(args, params):
    """Prints a row for each number of accelerators."""
    pixels = SIDES[0] * SIDES[1]
    sent = 3 * pixels + pixels + 4096 * 12
    print("| GPUs | samples/s | cores, plain | cores, augmented | cores, cached | records read "
          "| to a GPU | all-reduce of a GPU | one epoch |\n|" + "---|" * 9)  # fmt: skip
    for gpus in args.gpus:
        rate = gpus * BATCH / (args.step_ms / 1e3)
        reduced = 2 * (gpus - 1) / gpus * params / (args.step_ms / 1e3)
        epoch = args.models * args.views / rate
        cores = [rate / per_core for per_core in (args.plain, args.augmented, args.cached)]
        print(f"| {gpus} | {rate:,.0f} | " + " | ".join(f"{c:,.0f}" for c in cores)
              + f" | {rate * args.record_kb / 1e3:,.0f} MB/s | {rate / gpus * sent / 1e9:.2f} GB/s"
              f" | {reduced / 1e9:.0f} GB/s | {epoch / 60:.1f} min |")  # fmt: skip


def data(args):
    """Prints the one-time cost of preparing the data."""
    images = args.models * args.views
    pixels = SIDES[0] * SIDES[1]
    on_device = 3 * pixels + pixels // 8 + POINTS * 3 * 2 + 4 * 34 + 1
    render = [images / rate / 3600 for rate in (args.fast_images, args.slow_images)]
    print("| | |\n|---|---|")
    print(f"| images | {args.models:,} x {args.views} = {images:,} |")
    print(f"| rendering | {render[0]:.0f} to {render[1]:.0f} core-hours |")
    print(f"| on 64 cores | {60 * render[0] / 64:.0f} to {60 * render[1] / 64:.0f} min |")
    print(f"| records | {images * args.record_kb / 1e6:.1f} GB |")
    print(f"| decoded | {images * args.cached_kb / 1e6:,.0f} GB |")
    print(
        f"| on the device | {on_device / 1e3:.0f} kB a sample, {images * on_device / 1e9:,.0f} GB |"
    )
    for memory in (80, 141):
        fits = 0.6 * memory * 1e9 / on_device
        print(f"| fits into a GPU of {memory} GB | {fits:,.0f} samples |")


def checkpoints(args, params):
    """Prints a row for each interval between checkpoints."""
    print("| `train.checkpoint_every` | every | written, Adam | with an average of the parameters |"
          "\n|---|---|---|---|")  # fmt: skip
    for every in (1_000, 5_000, 20_000):
        seconds = every * args.step_ms / 1e3
        print(f"| {every:,} | {seconds:.0f} s | {3 * params / 1e6:.0f} MB, "
              f"{3 * params / 1e6 / seconds:.1f} MB/s | {4 * params / 1e6:.0f} MB, "
              f"{4 * params / 1e6 / seconds:.1f} MB/s |")  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gpus", nargs="*", type=int, default=[1, 8, 64])
    parser.add_argument("--models", type=int, default=50_000)
    parser.add_argument("--views", type=int, default=24)
    parser.add_argument("--step_ms", type=float, default=6.0,
                        help=f"of {BATCH} samples: tests/bench/gpu.py --parts c")  # fmt: skip
    parser.add_argument("--plain", type=float, default=952,
                        help="samples per CPU second: tests/bench/loader.py")  # fmt: skip
    parser.add_argument("--augmented", type=float, default=723, help="likewise")
    parser.add_argument("--cached", type=float, default=6824, help="likewise, data.cache")
    parser.add_argument("--cached_kb", type=float, default=250, help="psgn_jax.data.batches")
    parser.add_argument("--record_kb", type=float, default=22.4, help="psgn inspect RECORDS")
    parser.add_argument("--slow_images", type=float, default=4.4,
                        help="images/s of a core: tests/bench/render.py")  # fmt: skip
    parser.add_argument("--fast_images", type=float, default=9.8, help="likewise: psgn free-set")
    args = parser.parse_args()
    params = parameter_bytes()
    training(args, params)
    print()
    data(args)
    print()
    checkpoints(args, params)


if __name__ == "__main__":
    main()
