"""CD against EMD in training: `psgn study losses [--runs=CD_RUN,EMD_RUN]`.

We compare the two-branch networks of the study `networks`, trained with the CD and with EMD + 5 CD,
or two finished runs. According to the paper, the CD "tends to scatter a few points in its uncertain
area", and the EMD is "more compact" but "sometimes overly shrinks local structures". So we measure
the shares of predicted (outliers) and true points (missed) farther than `FAR` from the other cloud.

Source: Fan, Su, Guibas, CVPR 2017, section 5.5 and its figure of both, which shows an example and
no numbers; networks, sizes and measures here are **ours**.
"""

import functools

import numpy as np
from scipy.spatial.distance import cdist

from psgn_jax.studies import architectures, figures
from psgn_jax.studies.runner import Case, Results, Study, evaluate
from psgn_jax.viewing import spheres

FAR = 0.1  # distance in radii beyond which a point is an outlier or missed

METRICS = {
    "cd_sq_radius2": "CD squared [radius^2]",
    "emd_radius": "EMD [radius]",
    "cd_l1_radius": "CD-L1 [radius]",
    "fscore": "F-score [%]",
    "cd_sq_pred_to_gt_radius2": "predicted points to truth [radius^2]",
    "cd_sq_gt_to_pred_radius2": "truth to predicted points [radius^2]",
    "outliers": "predicted points farther than .1 from the truth [%]",
    "missed": "true points farther than .1 from the prediction [%]",
    "unevenness": "unevenness: std over mean of the distance to the nearest other point",
}
COLOURS, TRUTH = ((70, 130, 180), (90, 165, 90)), (165, 165, 165)  # as in the paper


def measure_sample(case: Case) -> dict[str, float]:
    """Outliers, missed points and unevenness of a prediction [n, 3], n > 1."""
    pred, gt = case["pred"], case["points"]
    gaps, among = cdist(pred, gt), cdist(pred, pred)
    np.fill_diagonal(among, np.inf)
    spacing = among.min(axis=1)
    return {
        "outliers": float(np.mean(gaps.min(axis=1) > FAR)),
        "missed": float(np.mean(gaps.min(axis=0) > FAR)),
        "unevenness": float(spacing.std() / max(spacing.mean(), 1e-12)),
    }


def figure(results: Results) -> figures.Figure:
    """A row for each sample: image; predictions and truth from the camera, then rotated."""
    rows, colours = [], dict(zip(results, COLOURS, strict=False))
    for number, case in next(iter(results.values()))[0].shown.items():
        shown = {name: results[name][0].shown[number]["pred"] for name in colours}
        painted = {name: (pred, colours[name]) for name, pred in shown.items()}
        painted["truth"] = spheres.thinned(case["points"], case["pred"]), TRUTH
        rows.append(spheres.panels(case, painted))
    return figures.grid(rows)


STUDY = Study(
    "losses",
    architectures.BASE,
    lambda *_: architectures.configs(["two_branch"]),
    METRICS,
    figure,
    functools.partial(evaluate, of_sample=measure_sample),
    pairs=[("two_branch_emd", "two_branch_cd")],
)
