"""How much procedural models differ from each other, compared with the authors' models.

    python tests/bench/shapes.py BATCHES [--categories car,plane] [--models 12] [--first_seed 0]

BATCHES is the folder of the authors' published batches. The distance of two models is the CD-L1
(half the sum of both mean nearest-neighbour distances) of 1,536 surface points each, at the best
rotation about z. Models are in units of the radius of their bounding hemisphere. The *isolation* of
a model is its distance to the nearest other model in a group of 12, minus the distance between two
samples of points of the same model. The table gives the mean isolation of the procedural models
divided by that of the authors' models of the same category. A ratio of 1 means that the procedural
models differ from each other as much as those of the authors.

The categories of the authors' models were determined from their images. The models are given by
their number: 32 * (number of the batch file) + position in the file.
"""

import argparse
import pathlib
import sys

import numpy as np
import scipy.spatial

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from data_gen.catalogues import procedural
from data_gen.surface import sample_surface
from psgn_jax.data.sources import authors

POINTS = 1536
TURNS = 36
REFINED = (-5.0, -2.5, 2.5, 5.0)

# fmt: off
AUTHORS = {
    "plane": (20, 34, 89, 130, 143, 147, 176, 233, 245, 251, 253, 255, 261, 288, 298, 301, 311, 351,
              357, 444, 458, 498, 560, 696),
    "bench": (11, 171, 354, 362, 390, 417, 784, 774, 828, 949, 1006, 1151, 1211, 1319),
    "cabinet": (43, 61, 77, 87, 115, 136, 151, 175, 281, 346, 366, 413, 593, 604, 634, 689, 759,
                870, 892, 909, 925, 929, 966, 988),
    "car": (7, 56, 67, 102, 122, 126, 185, 199, 227, 365, 520, 525, 587, 596, 615, 682, 685, 731,
            782, 812, 821, 861, 883, 888),
    "chair": (15, 59, 73, 80, 82, 104, 113, 125, 132, 144, 200, 210, 235, 248, 274, 276, 313, 378,
              382, 437, 449, 461, 497, 543),
    "monitor": (118, 163, 641, 688, 707, 728, 844, 846, 1069, 1089, 1104, 1153, 1297, 1299, 1326,
                978),
    "lamp": (100, 138, 179, 213, 239, 330, 347, 425, 431, 447, 516, 584, 669, 804, 933, 973, 1054,
             1091, 1238, 1463),
    "speaker": (61, 434, 481, 537, 692, 942, 1096, 1422, 1478, 1502, 803, 770),
    "firearm": (5, 92, 154, 224, 231, 304, 306, 310, 349, 350, 356, 406, 436, 480, 504, 614, 627,
                656, 694, 698, 815, 985, 1011, 1052),
    "couch": (0, 85, 103, 177, 254, 280, 294, 300, 403, 517, 581, 662, 699, 705, 712, 749, 847, 976,
              984, 995, 1037, 1043, 1128, 1220),
    "table": (3, 9, 12, 24, 47, 58, 63, 65, 90, 98, 99, 146, 158, 167, 172, 196, 211, 215, 256, 326,
              328, 391, 392, 408),
    "cellphone": (36, 152, 409, 569, 655, 946, 1113, 1384, 1397),
    "watercraft": (23, 137, 212, 336, 352, 359, 401, 530, 534, 771, 854, 963, 1031, 1057, 1155,
                   1240, 1243, 1251, 1272, 1361, 1365, 1373, 1431, 1456),
}
# fmt: on


def _turned(points, degrees):
    angle = np.deg2rad(degrees)
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def _cd_l1(points, tree, other, other_tree):
    return (tree.query(other)[0].mean() + other_tree.query(points)[0].mean()) / 2


def aligned_distance(one, two):
    """CD-L1 of two clouds at the best of the rotations about z."""
    tree_one, few = scipy.spatial.cKDTree(one), slice(None, None, 4)
    tree_few = scipy.spatial.cKDTree(one[few])
    step = 360 / TURNS
    coarse = []
    for k in range(TURNS):
        turned = _turned(two[few], k * step)
        coarse.append(_cd_l1(one[few], tree_few, turned, scipy.spatial.cKDTree(turned)))
    best = []
    for k in np.argsort(coarse)[:3]:
        for offset in (0.0, *REFINED):
            turned = _turned(two, k * step + offset)
            best.append(_cd_l1(one, tree_one, turned, scipy.spatial.cKDTree(turned)))
    return min(best)


def isolation(first, second, group, rng, groups=20):
    """Mean and spread of the isolation over random groups, and the mean distance within a model.

    The latter is the distance between two samples of points of the same model.

    Args:
      first, second: two samples of points of each model.
    """
    count = len(first)
    floor = np.mean(
        [
            _cd_l1(a, scipy.spatial.cKDTree(a), b, scipy.spatial.cKDTree(b))
            for a, b in zip(first, second, strict=True)
        ]
    )
    distance = np.full((count, count), np.inf)
    for i in range(count):
        for j in range(i):
            distance[i, j] = distance[j, i] = aligned_distance(first[i], second[j])
    means = []
    for _ in range(groups):
        chosen = rng.permutation(count)[:group]
        means.append(distance[np.ix_(chosen, chosen)].min(axis=1).mean() - floor)
    return float(np.mean(means)), float(np.std(means)), float(floor)


def _normalized(points):
    """The points on the ground, in units of the radius of the bounding hemisphere."""
    low, high = points.min(axis=0), points.max(axis=0)
    moved = points - [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]
    return moved / np.linalg.norm(moved, axis=1).max()


def authors_clouds(folder, numbers, rng):
    """Two samples of points of each of the authors' models."""
    result = []
    for number in sorted(numbers):
        entry = next(
            e for k, e in enumerate(authors.read_batch(folder / f"{number // 32}.gz"))
            if k == number % 32
        )  # fmt: skip
        points = _normalized(entry.sample.points.astype(np.float64))
        chosen = rng.permutation(len(points))[: 2 * POINTS]
        result.append((points[chosen[:POINTS]], points[chosen[POINTS:]]))
    return [list(clouds) for clouds in zip(*result, strict=True)]


def our_clouds(category, count, first_seed):
    """Two samples of points of each of `count` procedural models."""
    first, second = [], []
    for seed in range(first_seed, first_seed + count):
        model = procedural.generate(category, seed)
        first.append(sample_surface(model, POINTS, 1).points.astype(np.float64))
        second.append(sample_surface(model, POINTS, 2).points.astype(np.float64))
    return first, second


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("batches", type=pathlib.Path)
    parser.add_argument("--categories", default=",".join(AUTHORS))
    parser.add_argument("--models", type=int, default=12)
    parser.add_argument("--drawn", type=int, default=24)
    parser.add_argument("--first_seed", type=int, default=0)
    arguments = parser.parse_args()
    print("category    ours            authors         ratio")
    for category in arguments.categories.split(","):
        rng = np.random.default_rng(0)
        numbers = AUTHORS[category][: arguments.drawn]
        group = min(arguments.models, len(numbers))
        theirs, their_spread, _ = isolation(
            *authors_clouds(arguments.batches, numbers, rng), group, rng
        )
        ours, our_spread, _ = isolation(
            *our_clouds(category, arguments.drawn, arguments.first_seed), group, rng
        )
        print(
            f"{category:11s} {ours:.4f} +- {our_spread:.4f} {theirs:.4f} +- {their_spread:.4f} "
            f"{ours / theirs:.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
