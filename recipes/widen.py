"""Makes a wider network that predicts the same clouds, to continue its training from there.

    python recipes/widen.py --weights small-6 --widths 8,16,48,96,192,384 --fc_widths 768,640
        --out wide.safetensors
    psgn train --config=pretrained --config.train.init=wide.safetensors
        --config.model.widths='(8,16,48,96,192,384)' --config.model.fc_widths='(768,640)'

A kernel of the wide network is the given kernel from old inputs to old outputs, zero from new
inputs to old outputs, and random to new outputs. So the new units do not change the prediction, but
have gradients. (Chen, Goodfellow, Shlens 2016, "Net2Net", copies units instead.) For `two_branch`
and `vanilla` without a random input.
"""

import argparse
import dataclasses
import pathlib
import sys

import jax
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from psgn_jax.models import networks
from psgn_jax.weights.file import read_weights, write_weights
from psgn_jax.weights.leaves import from_named_leaves, named_leaves
from psgn_jax.weights.opening import weights_path

SEED = 77


def widened(new, old, cells):
    """The values `old` within the random values `new`; inputs are the channels of each cell."""
    if new.ndim == 1:
        return np.concatenate([old, new[len(old) :]])
    grid, part = (a.reshape(*a.shape[:-2], cells, -1, a.shape[-1]).copy() for a in (new, old))
    inputs, outputs = part.shape[-2:]
    grid[..., :outputs] = 0
    grid[..., :inputs, :outputs] = part
    return grid.reshape(new.shape)


def numbers(text):
    """The integers of a list like `8,16`."""
    return tuple(map(int, text.split(",")))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--weights", default="", help="file or name; default: the package's")
    parser.add_argument("--widths", type=numbers, required=True, help="at least the given ones")
    parser.add_argument("--fc_widths", type=numbers, required=True, help="at least the given ones")
    parser.add_argument("--out", required=True, help="the file of the wide network")
    arguments = parser.parse_args()
    old = read_weights(weights_path(arguments.weights))
    widths = {"widths": arguments.widths, "fc_widths": arguments.fc_widths}
    model = dataclasses.replace(old.config.model, **widths)
    config = dataclasses.replace(old.config, seed=SEED, model=model)
    network = networks.build(model)
    random = networks.init_params(config, network)
    leaves = named_leaves(random)
    for name, values in named_leaves(old.params).items():
        cells = 1
        if name == "fc.hidden0.kernel":  # of all cells of the bottleneck
            cells = len(values) // old.config.model.widths[-1]
        leaves[name] = widened(np.asarray(leaves[name]), np.asarray(values), cells)
    params = from_named_leaves(random, leaves)

    images = np.random.default_rng(0).random((4, *model.image_size, model.in_channels), np.float32)
    before = networks.build(old.config.model).apply({"params": old.params}, images, None)
    difference = float(abs(network.apply({"params": params}, images, None) - before).max())
    if difference > 1e-5:
        raise SystemExit(f"the clouds differ by {difference:.2g} radius: another kind of network")
    figures = {**old.figures, "parameters": sum(np.size(leaf) for leaf in jax.tree.leaves(params))}
    new = dataclasses.replace(old, config=config, params=params, figures=figures, dtype="float32")
    write_weights(arguments.out, new)
    print(f"{figures['parameters']:,} parameters; the clouds differ by {difference:.1g} radius")


if __name__ == "__main__":
    main()
