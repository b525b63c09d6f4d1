"""Slow and simple float64 references for the functions of the package."""

import numpy as np


def pairwise_sq(a, b):
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    return ((a[:, None, :] - b[None, :, :]) ** 2).sum(-1)


def _nearest_sq(pred, gt):
    """Squared distances to the nearest: of the points of pred, and of those of gt."""
    d = pairwise_sq(pred, gt)
    return d.min(1), d.min(0)


def _of_both(combine):
    return lambda pred, gt: combine(*_nearest_sq(pred, gt))


chamfer_sq = _of_both(lambda of_pred, of_gt: of_pred.sum() + of_gt.sum())
chamfer_sq_pred_to_gt_mean = _of_both(lambda of_pred, of_gt: of_pred.mean())
chamfer_sq_gt_to_pred_mean = _of_both(lambda of_pred, of_gt: of_gt.mean())
chamfer_sq_mean = _of_both(lambda of_pred, of_gt: of_pred.mean() + of_gt.mean())
chamfer_l1_mean = _of_both(lambda *both: sum(np.sqrt(d).mean() for d in both) / 2)
chamfer_authors = _of_both(lambda of_pred, of_gt: 1e4 * (of_gt.mean() + of_pred.mean() / 2))


def fscore(pred, gt, threshold):
    precision, recall = ((np.sqrt(d) <= threshold).mean() for d in _nearest_sq(pred, gt))
    if precision + recall == 0:
        return 0.0, precision, recall
    return 2 * precision * recall / (precision + recall), precision, recall


def by_visibility(pred, gt, visible, threshold):
    """(mean square, mean distance, recall) of the "visible" and of the "hidden" true points.

    The values of an empty subset are NaN.
    """
    found = {}
    for name, chosen in (("visible", visible), ("hidden", ~visible)):
        squares = _nearest_sq(pred, gt[chosen])[1] if chosen.any() else np.array([np.nan])
        d = np.sqrt(squares)
        recall = (d <= threshold).mean() if chosen.any() else np.nan
        found[name] = squares.mean(), d.mean(), recall
    return found


def cross_chamfer(a, b):
    """chamfer_sq_mean of every cloud of a and every cloud of b."""
    return np.array([[chamfer_sq_mean(x, y) for y in b] for x in a])


def total_mutual_difference(draws):
    d = cross_chamfer(draws, draws)  # zero on the diagonal
    return d.sum() / (len(draws) - 1)


def coverage(draws, truths):
    d = cross_chamfer(draws, truths)
    return len({int(row.argmin()) for row in d}) / len(truths)


def distances(a, b):
    return np.sqrt(pairwise_sq(a, b))


def emd_sum(pred, gt):
    """The least sum of distances over all bijections, by SciPy."""
    from scipy.optimize import linear_sum_assignment

    d = distances(pred, gt)
    return d[linear_sum_assignment(d)].sum()


def matching_cost(pred, gt, index):
    return distances(pred, gt)[np.arange(len(index)), np.asarray(index)].sum()


def emd_lower_bound(pred, gt, prices):
    """The lower bound that prices p of gt prove: sum_i min_j (c_ij + p_j) - sum_j p_j."""
    prices = np.asarray(prices, np.float64)
    return (distances(pred, gt) + prices[None]).min(1).sum() - prices.sum()


def farthest_points(points, num_samples):
    points = np.asarray(points, np.float64)
    chosen = [0]
    while len(chosen) < num_samples:
        nearest_sq = pairwise_sq(points, points[chosen]).min(1)
        nearest_sq[chosen] = -1
        chosen.append(int(nearest_sq.argmax()))
    return np.array(chosen)
