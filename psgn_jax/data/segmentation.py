"""Finds the object in a photo by its colours: the best of several GrabCuts.

The result of GrabCut (Rother, Kolmogorov, Blake, "GrabCut", SIGGRAPH 2004) depends on the first
guess of the mask. Here it is started from several guesses (seeds) on a small copy of the image:

- the image without a band along its border; ellipses in the middle;
- the minimum barrier distance from the border, which is large where every path to the border
  crosses a change of colour (Zhang et al., "Minimum Barrier Salient Object Detection at 80 FPS",
  ICCV 2015);
- the difference from the colours of the border;
- the geometric mean of the last two quantities.

Each result is a candidate, and so is the set of pixels that most results contain. The candidate
that agrees best with the others, with a small preference for better seeds, is refined along its
outline on a larger copy. Its score estimates its IoU with the object. The weights of the score and
of the preference were fitted to photos and composites with known masks. In this fit, features such
as contrast and compactness helped to distinguish bad results from good ones, but not to choose
among the results of one image. Nothing is random.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

DOUBTFUL = 0.7
"""A mask with a lower score is doubtful."""

# Largest number of pixels per side of the copies for the search and for the outline.
_SEARCH_SIDE, _FINE_SIDE = 144, 400

# Weights of the features of `_score`, and the score of a candidate whose features are 0.
_WEIGHTS = (0.4494, -0.2331, -0.0102, 1.0311, -0.0525, -6.3894, 0.2119, -0.1135)
_SCORE_OF_NONE = -0.3542

# The rank of a candidate: its agreement with the others times this, and the number of its seed.
_RANK_OF_AGREEMENT = 0.5
_RANK_OF_SEED = {
    "band": 0.007,
    "ellipse": -0.019,
    "middle": -0.015,
    "barrier": -0.009,
    "border": 0.023,
    "both": 0.005,
    "agreement": 0.005,
}
_ELLIPSES = {"ellipse": 0.75, "middle": 0.45}  # semi-axes, relative to the image

_BAND = 0.03  # width of the border that is background, relative to the image
_ROUNDS = 3
_LEAST_RANGE = 8  # an image with a smaller range in every channel counts as one colour


class Found(NamedTuple):
    """A mask, bool [h, w] of a reduced copy, and the estimate of its IoU with the object."""

    mask: np.ndarray
    score: float


def segment(image: np.ndarray) -> Found | None:
    """The object in an image, uint8 [h, w, 3]; None if there is no candidate.

    The mask has the size of a copy of the image with at most 400 pixels per side.
    """
    small = _reduced(image, _SEARCH_SIDE)
    if np.ptp(small, axis=(0, 1)).max() < _LEAST_RANGE:
        return None
    lab = cv2.cvtColor(small.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    salience = _salience(lab)
    masks: dict[str, np.ndarray] = {}
    for name, labels in _first_guesses(small, salience).items():
        first = (labels == cv2.GC_PR_FGD) if name in salience else None
        cut = _grabcut(small, labels, _ROUNDS)
        for mask in (cut, first):  # GrabCut may find nothing
            if mask is not None and (mask := _main_parts(mask)).any():
                masks[name] = mask
                break
    if not masks:
        return None
    share = np.mean(list(masks.values()), axis=0)
    if (mask := _main_parts(share > 0.5)).any():
        masks["agreement"] = mask
    stack = np.stack([mask.ravel() for mask in masks.values()]).astype(np.float32)
    common = stack @ stack.T
    areas = stack.sum(axis=1)
    overlaps = common / (areas[:, None] + areas[None] - common)
    agreement = (overlaps.sum(axis=1) - 1) / max(len(masks) - 1, 1)
    ranks = _RANK_OF_AGREEMENT * agreement + [_RANK_OF_SEED[name] for name in masks]
    best = int(np.argmax(ranks))
    mask = list(masks.values())[best]
    features = (float(agreement[best]), *_features(mask, lab, salience["both"]))
    score = float(np.dot(_WEIGHTS, features)) + _SCORE_OF_NONE
    return Found(_refined(_reduced(image, _FINE_SIDE), mask), score)


def _first_guesses(small: np.ndarray, salience: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """GrabCut's labels at the start, by name."""
    shape = small.shape[:2]
    down, across = (max(1, round(_BAND * side)) for side in shape)
    rows, columns = _coordinates(shape)
    probable = {"band": np.ones(shape, np.bool_)}
    for name, axis in _ELLIPSES.items():
        probable[name] = (rows / axis) ** 2 + (columns / axis) ** 2 < 1
    for name, values in salience.items():
        share = np.clip(values / max(np.quantile(values, 0.99), 0.05), 0, 1)
        level = (255 * share).astype(np.uint8)
        threshold, _ = cv2.threshold(level, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        probable[name] = level > threshold
    guesses = {}
    for name, inner in probable.items():
        guesses[name] = np.full(shape, cv2.GC_BGD, np.uint8)
        middle = np.s_[down:-down, across:-across]
        guesses[name][middle] = np.where(inner, cv2.GC_PR_FGD, cv2.GC_PR_BGD)[middle]
    return guesses


def _salience(lab: np.ndarray) -> dict[str, np.ndarray]:
    """Values that are large on the object, [h, w] by name of the guess."""
    central = _central(lab.shape[:2], 0.6)
    barrier, border = (
        np.clip(each / max(np.quantile(each, 0.98), 0.5), 0, 1)
        for each in (_barrier_distance(lab), _unlike_border(lab))
    )
    return {
        "barrier": barrier * central,
        "border": border * central,
        "both": np.sqrt(barrier * border) * central,
    }


def _barrier_distance(lab: np.ndarray, rounds: int = 2) -> np.ndarray:
    """The minimum barrier distance [h, w] from the border, summed over the channels.

    The barrier of a path is the range of the values on it. Sweeps over rows and columns in four
    directions approximate the minimum over paths: each line takes the paths of its neighbour that
    are better.
    """
    values = cv2.GaussianBlur(lab, (0, 0), 1.0)
    distance = np.full(values.shape, np.inf, np.float32)
    distance[[0, -1]] = 0
    distance[:, [0, -1]] = 0
    low, high = values.copy(), values.copy()
    planes = [values, distance, low, high]
    turned = [plane.transpose(1, 0, 2) for plane in planes]
    for _ in range(rounds):
        for v, d, lowest, highest in (planes, turned):
            count = len(v)
            for lines, step in ((range(1, count), -1), (range(count - 2, -1, -1), 1)):
                for i in lines:
                    above = np.maximum(highest[i + step], v[i])
                    below = np.minimum(lowest[i + step], v[i])
                    better = above - below < d[i]
                    np.copyto(d[i], above - below, where=better)
                    np.copyto(highest[i], above, where=better)
                    np.copyto(lowest[i], below, where=better)
    total: np.ndarray = distance.sum(axis=2)
    return total


def _unlike_border(lab: np.ndarray, clusters: int = 6) -> np.ndarray:
    """Distance [h, w] from the nearest cluster of border colours, in standard deviations."""
    height, width = lab.shape[:2]
    wide = max(2, round(0.05 * min(height, width)))
    inner = np.zeros((height, width), np.bool_)
    inner[wide:-wide, wide:-wide] = True
    border = np.ascontiguousarray(lab[~inner])
    cv2.setRNGSeed(0)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 12, 0.5)
    labels = np.zeros((len(border), 1), np.int32)
    _, labels, centres = cv2.kmeans(  # type: ignore[assignment]
        border, clusters, labels, stop, 1, cv2.KMEANS_PP_CENTERS
    )
    result = np.full((height, width), 12.0, np.float32)
    for number, centre in enumerate(centres):
        members = border[labels.ravel() == number]
        if len(members) >= 0.02 * len(border):
            spread = np.maximum(members.std(axis=0), 2.0)
            result = np.minimum(result, np.sqrt((((lab - centre) / spread) ** 2).sum(axis=2)))
    return result


def _grabcut(image: np.ndarray, labels: np.ndarray, rounds: int) -> np.ndarray | None:
    """GrabCut's mask; None where it cannot fit two colour models. Changes `labels`."""
    back, fore = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)
    mode = cv2.GC_INIT_WITH_MASK
    try:
        cv2.grabCut(np.ascontiguousarray(image), labels, (0, 0, 1, 1), back, fore, rounds, mode)
    except cv2.error:
        return None
    mask: np.ndarray = (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)
    return mask


def _main_parts(mask: np.ndarray) -> np.ndarray:
    """The largest parts, with small holes filled; pixels in the middle of the image count more."""
    central = _central(mask.shape, 0.5)
    count, parts = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    if count > 1:
        weight = np.bincount(parts.ravel(), (central * mask).ravel(), count)
        mask = (weight >= 0.2 * weight.max())[parts] & mask
    _, holes, statistics, _ = cv2.connectedComponentsWithStats(
        (~mask).astype(np.uint8), connectivity=4
    )
    small = statistics[:, cv2.CC_STAT_AREA] < 0.004 * mask.sum()
    small[0] = False
    filled: np.ndarray = mask | small[holes]
    return filled


def _refined(image: np.ndarray, coarse: np.ndarray) -> np.ndarray:
    """The mask on a larger image, with another GrabCut along its outline."""
    size = image.shape[1::-1]
    level = cv2.resize(coarse.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    mask = level > 0.5
    reach = max(2, round(0.02 * max(size)))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    bits = mask.astype(np.uint8)
    labels = np.where(mask, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[cv2.dilate(bits, kernel) == 0] = cv2.GC_BGD
    labels[cv2.erode(bits, kernel) == 1] = cv2.GC_FGD
    finer = _grabcut(image, labels, 1)
    return mask if finer is None or not finer.any() else _main_parts(finer)


def _coordinates(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Rows [h, 1] and columns [1, w] of the pixels of an image [h, w], each from -1 to 1."""
    return np.linspace(-1, 1, shape[0])[:, None], np.linspace(-1, 1, shape[1])[None]


def _central(shape: tuple[int, ...], spread: float) -> np.ndarray:
    """Weights [h, w] that fall from the middle of an image, with this standard deviation."""
    rows, columns = _coordinates(shape)
    weights: np.ndarray = np.exp(-(rows**2 + columns**2) / (2 * spread**2))
    return weights


def _reduced(image: np.ndarray, side: int) -> np.ndarray:
    height, width = image.shape[:2]
    factor = side / max(height, width)
    if factor >= 1:
        return np.ascontiguousarray(image)
    size = max(8, round(factor * width)), max(8, round(factor * height))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def _features(mask: np.ndarray, lab: np.ndarray, salience: np.ndarray) -> tuple[float, ...]:
    """The features of a mask after its agreement with the others, in the order of `_WEIGHTS`.

    Contrast of the colours on both sides of the outline; gradient on the outline; Hellinger
    distance of the histograms of both sides' colours; compactness; share of the border that the
    mask covers; difference of the salience; number of parts.
    """
    bits = mask.astype(np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    outline = (cv2.dilate(bits, kernel) - cv2.erode(bits, kernel)).astype(np.bool_)
    contours, _ = cv2.findContours(bits, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    length = sum(cv2.arcLength(contour, True) for contour in contours)
    down, across = (max(1, round(_BAND * side)) for side in mask.shape)
    border = np.concatenate([mask[down], mask[-down - 1], mask[:, across], mask[:, -across - 1]])
    gradient = np.hypot(
        *(cv2.Sobel(lab, cv2.CV_32F, *order).max(axis=2) for order in ((1, 0), (0, 1)))
    )

    def mean_near(weights: np.ndarray) -> np.ndarray:
        total = cv2.GaussianBlur(lab * weights[..., None], (0, 0), 2.5)
        return total / np.maximum(cv2.GaussianBlur(weights, (0, 0), 2.5), 1e-3)[..., None]

    sides = mean_near(bits.astype(np.float32)) - mean_near(1 - bits.astype(np.float32))
    contrast = float(np.sqrt((sides**2).sum(axis=2))[outline].mean()) / 100
    cells = (lab + np.array((0, 80, 80), np.float32)) / np.array((12.5, 20, 20), np.float32)
    bins = np.clip(cells, 0, 7.99).astype(np.intp) @ [64, 8, 1]
    counts = [np.bincount(bins[side], minlength=512) for side in (mask, ~mask)]
    roots = [np.sqrt(count / max(count.sum(), 1)) for count in counts]
    return (
        contrast,
        float(np.log((gradient[outline].mean() + 1) / (gradient.mean() + 1))),
        math.sqrt(max(0.0, 1 - float(np.dot(*roots)))),
        min(1.0, 4 * math.pi * float(mask.sum()) / max(length, 1) ** 2),
        float(border.mean()),
        float(salience[mask].mean() - salience[~mask].mean()) if not mask.all() else 0.0,
        float(len(contours)),
    )
