"""A prediction of 10,000 images: every intact image has a result, and memory is bounded."""

import pathlib
import random
import shutil
import time

from PIL import Image

from campaign import frame, load, runs
from campaign.command_kills import IMPORTS
from campaign.forks import Forks

MOST, FEW = 10_000, 50
SECONDS_EACH = 0.03
DAMAGED_EVERY = 100


def _write(folder: pathlib.Path, count: int, rng: random.Random) -> pathlib.Path:
    """Images of boxes; a few of them are damaged."""
    folder.mkdir()
    for number in range(count):
        path = folder / f"{number:05d}.png"
        if number >= 50:  # copies, because encoding takes time
            shutil.copyfile(folder / f"{number % 50:05d}.png", path)
            if number % DAMAGED_EVERY == 0:
                path.write_bytes(path.read_bytes()[:100])
            continue
        picture = Image.new("RGB", (64, 48), (191, 191, 191))
        left, top = rng.randint(2, 20), rng.randint(2, 15)
        corner = (left + rng.randint(15, 40), top + rng.randint(12, 28))
        picture.paste((200, 60, rng.randrange(256)), (left, top, *corner))
        picture.save(path)
    return folder


def part(rng: random.Random, deadline: float, folder: pathlib.Path) -> list[frame.Finding]:
    """The part of the campaign; see the module."""
    count = load.scaled(deadline - time.monotonic(), SECONDS_EACH, 200, MOST)
    records, base = runs.make_records(folder / "records"), folder / "base"
    log = folder / "log"
    made = {}
    with Forks(IMPORTS, **runs.quick(folder)) as forks:
        ended = forks.run(runs.training(records, base), log)
        if ended.code:
            return [frame.Finding("a training", 1, 0, [ended.text[-2000:]])]
        for number, again in ((FEW, "cold"), (FEW, ""), (count, "")):  # the first one compiles
            images = _write(folder / f"images{number}{again}", number, rng)
            command = ["-m", "psgn_jax.predict", str(images), f"--workdir={base}",
                       f"--out={folder / f'out{number}{again}'}", "--formats=npz"]  # fmt: skip
            made[number] = forks.run(command, log, 3600)
    damaged = (count - 1) // DAMAGED_EVERY
    finding = frame.Finding(load.title(f"{count:,} images, {damaged} damaged", *made.values()))
    few, many = made.values()
    if few.code == 0 and damaged:
        few = frame.Ended(1, few.text, few.seconds, few.memory)
    wrong = load.wrong(few, many, 1 if damaged else 0)
    files = len(list((folder / f"out{count}").glob("*.npz")))
    if not wrong and files != count - damaged:
        wrong = f"{files} files, expected {count - damaged}"
    finding.add(wrong)
    return [finding]
