"""A data set of 100,000 records: `inspect` succeeds, a training reads all, memory is bounded."""

import itertools
import pathlib
import random
import time
from collections.abc import Iterator

from helpers import drawn_solids

from campaign import frame, load, runs
from campaign.forks import TRAINING, Forks
from psgn_jax.data.codec import encode
from psgn_jax.data.dataset import ShardWriter
from psgn_jax.data.manifest import Manifest, save_manifest

MOST, FEW, PER_SHARD = 100_000, 500, 500
SECONDS_EACH = 0.003
DIFFERENT = 100
BATCH = 100
IMPORTS = (*TRAINING, "psgn_jax.viewing.dataset")


def _write(folder: pathlib.Path, count: int, seed: int) -> pathlib.Path:
    """A data set of `count` records, which repeat `DIFFERENT` samples."""
    folder.mkdir()
    samples = list(drawn_solids.samples(DIFFERENT, seed=seed, image_size=runs.SIZE))
    encoded = [(encode(sample), sample) for sample in samples]
    records: Iterator = itertools.islice(itertools.cycle(encoded), count)
    shards = []
    for number in range(-(-count // PER_SHARD)):
        with ShardWriter(folder, "train", number) as writer:
            for record, sample in itertools.islice(records, PER_SHARD):
                writer.write(record, sample)
        shards.append(writer.shard)
    with ShardWriter(folder, "validation", 0) as writer:
        for record, sample in encoded[:8]:
            writer.write(record, sample)
    save_manifest(folder, Manifest("campaign", True, (*shards, writer.shard)))
    return folder


def part(rng: random.Random, deadline: float, folder: pathlib.Path) -> list[frame.Finding]:
    """The part of the campaign; see the module."""
    count = load.scaled(deadline - time.monotonic(), SECONDS_EACH, 2_000, MOST)
    count -= count % BATCH
    seed = rng.randrange(1000)
    sets = {n: _write(folder / f"records{n}", n, seed) for n in (FEW, count)}
    findings = []
    with Forks(IMPORTS, **runs.quick(folder)) as forks:
        looked, trained = {}, {}
        # The first small run compiles, which takes more memory than anything else.
        for number, again in ((FEW, "cold"), (FEW, ""), (count, "")):
            records = sets[number]
            sheet = folder / f"{number}.png"
            command = ["-m", "psgn_jax.inspect", str(records), f"--sheet={sheet}"]
            looked[number] = forks.run(command, folder / "log")
            command = runs.training(
                records,
                folder / f"run{number}{again}",
                train__batch_size=BATCH,
                train__steps=number // BATCH,
                train__checkpoint_every=1000,
                train__eval_every=1000,
            )
            trained[number] = forks.run(command, folder / "log", 1800)
    for what, both in (("inspect", looked), ("one epoch of training", trained)):
        finding = frame.Finding(load.title(f"{count:,} records, {what}", both[FEW], both[count]))
        wrong = load.wrong(both[FEW], both[count])
        finding.add(wrong or (_not_seen(both[count], count) if what == "inspect" else ""))
        findings.append(finding)
    return findings


def _not_seen(ended: frame.Ended, count: int) -> str:
    return "" if f"split train: {count} samples" in ended.text else ended.text[:500]
