"""Shape completion from one RGB-D image: `psgn study completion`.

We train the same network with RGB and with RGB-D images. We measure the true points that the depth
image shows (visible) separately from the others (hidden). In the figure, visible true points are
blue, hidden points orange, and each predicted point has the colour of the nearest true point.

Source: Fan, Su, Guibas, CVPR 2017, section "Shape Completion from RGBD Images", which shows images
and no numbers; networks, sizes and measures here are **ours**.
"""

import functools

import numpy as np
from scipy.spatial.distance import cdist

from psgn_jax.studies import figures
from psgn_jax.studies.runner import CASE, Results, Study, evaluate
from psgn_jax.viewing import spheres

METRICS = {
    "cd_sq_radius2": "CD squared [radius^2]",
    "cd_l1_radius": "CD-L1 [radius]",
    "emd_radius": "EMD [radius]",
    "fscore": "F-score [%]",
    "cd_sq_pred_to_gt_radius2": "predicted points to truth [radius^2]",
    "cd_sq_gt_to_pred_visible_radius2": "visible true points to prediction [radius^2]",
    "cd_sq_gt_to_pred_hidden_radius2": "hidden true points to prediction [radius^2]",
    "cd_l1_gt_to_pred_visible_radius": "visible true points to prediction [radius]",
    "cd_l1_gt_to_pred_hidden_radius": "hidden true points to prediction [radius]",
    "recall_visible": "recall of visible points [%]",
    "recall_hidden": "recall of hidden points [%]",
}
VISIBLE, HIDDEN = (40, 95, 190), (225, 120, 30)


def figure(results: Results) -> figures.Figure:
    """Image and depth; both predictions and the truth from the camera, then rotated."""
    rows = []
    for number, case in results["rgbd"][0].shown.items():
        truth = case["points"]
        colours = np.where(case["visible"][:, None], VISIBLE, HIDDEN)
        painted = {}
        for title in ("rgb", "rgbd"):
            pred = results[title][0].shown[number]["pred"]
            painted[title] = pred, colours[cdist(pred, truth).argmin(axis=1)]
        pred = case["pred"]
        painted["truth"] = spheres.thinned(truth, pred), spheres.thinned(colours, pred)
        image, *others = spheres.panels(case, painted).items()
        depth = np.where(case["depth"] > 0, case["depth"], np.nan)
        rows.append(dict([image, ("depth", depth), *others]))
    return figures.grid(rows)


STUDY = Study(
    "completion",
    {"train.steps": 1800},
    lambda *_: {
        "rgb": {"data.inputs": ("rgb", "mask")},
        "rgbd": {"data.inputs": ("rgb", "mask", "depth")},
    },
    METRICS,
    figure,
    functools.partial(evaluate, keys=(*CASE, "depth", "visible")),
    pairs=[("rgbd", "rgb")],
    note="Visible: within `eval.visible_tolerance` of a surface point in the depth image.",
)
