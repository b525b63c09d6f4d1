"""A filter that averages light over pixels of the same surface."""

import numpy as np
from jaxtyping import Bool, Float


def smooth(
    values: Float[np.ndarray, "h w 3"],
    valid: Bool[np.ndarray, "h w"],
    guides: Float[np.ndarray, "h w 7"] | None,
    *,
    step: int = 1,
) -> Float[np.ndarray, "h w 3"]:
    """Weighted means over 5 x 5 pixels of the same surface (weights 1/2, 1, 1, 1, 1/2 per axis).

    Args:
      values: values to smooth.
      valid: pixels that have a value.
      guides: for each pixel its normal n, its position p and a tolerance. Another pixel is on the
        same surface if its normal is similar and its distance from the plane through p
        perpendicular to n is less than `step` times the tolerance. None = all pixels are on one
        surface.
      step: distance between the pixels.
    """
    result = values
    for axis in (0, 1):
        total = np.zeros_like(values)
        weight = np.zeros((*valid.shape, 1), np.float32)
        for offset, share in zip((-2, -1, 0, 1, 2), (0.5, 1, 1, 1, 0.5), strict=True):
            here, there = [slice(None)] * 2, [slice(None)] * 2
            size = valid.shape[axis]
            move = offset * step
            here[axis] = slice(max(0, -move), min(size, size - move))
            there[axis] = slice(max(0, move), min(size, size + move))
            at, source = tuple(here), tuple(there)
            part = share * (valid[at] & valid[source]).astype(np.float32)
            if guides is not None and offset:
                mine, its = guides[at], guides[source]
                same = np.einsum("hwd,hwd->hw", mine[..., :3], its[..., :3])
                off = np.abs(
                    np.einsum("hwd,hwd->hw", mine[..., :3], mine[..., 3:6] - its[..., 3:6])
                )
                part = part * np.clip(10 * same - 8.5, 0, 1) * (off < mine[..., 6] * step)
            total[at] += part[..., None] * result[source]
            weight[at] += part[..., None]
        result = total / np.maximum(weight, 1e-6)
    return result
