"""Where an object lies in the image: one rule for training, evaluation and prediction.

**Where training objects lie.** The authors scale an object to a bounding hemisphere of radius 1 and
look at it with one camera, so its place in the image follows from its proportions. In their 1,504
images (192x256) the mask's box, `h` x `w` pixels, keeps near the curve

    (w / 223)^4 + (h / 124)^4 = 1

(standard deviation of the scale about it 12 %): wide objects are some 220 pixels wide, tall ones
some 125 high. The box's middle lies at column 128 (sd 11) and at row 63 + 0.224 w (sd 14): a tall
object stands on the ground, whose origin is at row 124; of a wide one some lies nearer than that.
`rule_move` puts an object's box onto that curve and that middle. Fitted by
`((1.8 h)^4 + w^4)^(1/4)` and least squares to the images that show at least 20 pixels of both
sides.

**Images and points together.** A photo does not show how large its object is nor where it stands.
A move of the image, column and row `p` to `s p + (right, down)`, therefore moves the points of a
training sample too, and the camera (K, R, T) stays as it is: `move_points`. In the camera's frame,
with rays `q = (x, y) / z`, the move is `q -> s q + (u, v)`, where (u, v) is the last column of
`K^-1 [[s, 0, right], [0, s, down], [0, 0, 1]] K`. The object is scaled about its centre, at the
centre's depth `z0` (mean over the points), and moved across the optical axis:

    X' = s X + z0 (u, v, 1 - s)

This is a similarity without rotation: the object keeps its shape and its angle to the ground. For
points at depth z0 the projection is exact. For a point at depth `z = z0 + d` it is off by

    q' - (s q + (u, v)) = s d / (z0 + s d) * ((1 - s) q - (u, v))

times the focal length in pixels. With the authors' camera (400 pixels, z0 about 3.6), a change of
size by 12 % misplaces a point at the image's left edge that is 0.4 in front of the centre by 1.7
pixels of 192x256, and a shift by 14 pixels misplaces it by 1.7; a point with d = 0.2 half-way to
the edge by 0.4 and 0.8. The root mean square over a box of 1 x 1.2 x 0.7 under a shift by 14 pixels
is 1.2. An exact move would have to shear the object (x' = s x + u z at the same z).
"""

import dataclasses

import numpy as np
from PIL import Image

from psgn_jax.data import camera, schema
from psgn_jax.data.photo import PhotoError, same_proportions

VIEW_SIZE = (192, 256)
BOX_WIDTH, BOX_HEIGHT, BOX_POWER = 223.0, 124.0, 4
MIDDLE_COLUMN, MIDDLE_ROW, MIDDLE_ROW_PER_WIDTH = 128.0, 63.0, 0.224

SMALLEST_BOX = 8
"""Pixels of the longer side of an object's box, below which it is not placed."""

_TRAINING_SPREAD = 1  # how far the border of a training rendering may be from its grey


@dataclasses.dataclass(frozen=True)
class Move:
    """A similarity of the image plane without rotation.

    It takes (column, row) to `scale * (column, row) + (right, down)`; pixels as in `schema`.
    """

    scale: float
    right: float
    down: float

    def matrix(self) -> np.ndarray:
        """float64 [3, 3] on homogeneous (column, row)."""
        return np.array([[self.scale, 0, self.right], [0, self.scale, self.down], [0, 0, 1.0]])

    def then(self, other: "Move") -> "Move":
        """This move first, `other` after it."""
        return Move(
            other.scale * self.scale,
            other.scale * self.right + other.right,
            other.scale * self.down + other.down,
        )


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """What a network sees of a photo, with its camera.

    Attributes:
      image: uint8 [192, 256, 3], grey 191 outside the mask.
      mask: bool [192, 256].
      intrinsics, extrinsics: the authors' camera for this view (`schema`: conventions).
      to_view: float64 [3, 3], homogeneous (column, row) of the array that was placed to those of
        the view. `inv(to_view) @ intrinsics` is the camera of that array.
      placed: False where the array was taken as framed.
    """

    image: np.ndarray
    mask: np.ndarray
    intrinsics: np.ndarray
    extrinsics: np.ndarray
    to_view: np.ndarray
    placed: bool


def is_framed(image: np.ndarray) -> bool:
    """Whether an image is framed as those of the training: 4:3, on grey 191 all around."""
    if not same_proportions(image.shape[:2], VIEW_SIZE):
        return False
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]]).astype(int)
    near = np.abs(border - schema.BACKGROUND_GREY).max(axis=1) <= _TRAINING_SPREAD
    return bool(near.mean() > 0.97)


def box_of(mask: np.ndarray) -> tuple[int, int, int, int]:
    """(top, bottom, left, right) of what a mask shows; bottom and right are excluded.

    Raises:
      PhotoError: the mask is empty.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        raise PhotoError("the mask is empty: no pixel of it is object")
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1


def rule_move(box: tuple[float, float, float, float]) -> Move:
    """The move of an object's box, in square pixels, to its place in a view of 192x256 pixels.

    Args:
      box: (top, bottom, left, right), as `box_of` gives it.
    """
    top, bottom, left, right = box
    wide, high = right - left, bottom - top
    relative = (wide / BOX_WIDTH) ** BOX_POWER + (high / BOX_HEIGHT) ** BOX_POWER
    scale = relative ** (-1 / BOX_POWER)
    row = MIDDLE_ROW + MIDDLE_ROW_PER_WIDTH * wide * scale
    across = MIDDLE_COLUMN - scale * (left + right) / 2
    return Move(scale, across, row - scale * (top + bottom) / 2)


def rule_move_within(mask: np.ndarray) -> Move | None:
    """The rule's move within an array that is a view of another size, such as a training sample.

    Args:
      mask: bool [h, w]; its rows and columns stand for 192 and 256.

    Returns:
      the move in the array's own pixels; None for an object of fewer than `SMALLEST_BOX` pixels.
    """
    if not mask.any():
        return None
    top, bottom, left, right = box_of(mask)
    if max(bottom - top, right - left) < SMALLEST_BOX:
        return None
    down, across = VIEW_SIZE[0] / mask.shape[0], VIEW_SIZE[1] / mask.shape[1]
    move = rule_move((top * down, bottom * down, left * across, right * across))
    return Move(move.scale, move.right / across, move.down / down)


def keep_inside(move: Move, mask: np.ndarray) -> Move:
    """The move made smaller until all of the object stays within the array [h, w].

    An object that is larger than the array after the move is scaled less; then it is shifted less.
    """
    top, bottom, left, right = box_of(mask)
    (height, width), scale = mask.shape, move.scale
    scale = min(scale, height / (bottom - top), width / (right - left))
    # Scaled less, the middle of the box stays where the move puts it.
    across = move.right + (move.scale - scale) * (left + right) / 2
    down = move.down + (move.scale - scale) * (top + bottom) / 2
    return Move(
        scale,
        float(np.clip(across, -scale * left, width - scale * right)),
        float(np.clip(down, -scale * top, height - scale * bottom)),
    )


def move_image(
    image: np.ndarray, mask: np.ndarray, to_view: np.ndarray, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Image and mask as a view of `size` (H, W) sees them; each pixel averages what it covers.

    Args:
      image: uint8 [h, w, 3].
      mask: bool [h, w].
      to_view: [3, 3], (column, row) of the array to those of the view; scales and a shift.
      size: of the view.

    Returns:
      uint8 [H, W, 3], grey 191 outside the mask, and bool [H, W].
    """
    # Corners of the view in the array; the region is cut out with grey where the array ends.
    factors = 1 / np.diag(to_view)[:2]
    low = -to_view[:2, 2] * factors
    high = (np.array(size[::-1]) - to_view[:2, 2]) * factors
    first = np.floor(low).astype(int)
    last = np.ceil(high).astype(int)
    rgba = np.full((last[1] - first[1], last[0] - first[0], 4), schema.BACKGROUND_GREY, np.uint8)
    rgba[..., 3] = 0
    begin = np.maximum(first, 0)
    end = np.minimum(last, image.shape[1::-1])
    source = np.s_[begin[1] : end[1], begin[0] : end[0]]
    target = np.s_[begin[1] - first[1] : end[1] - first[1], begin[0] - first[0] : end[0] - first[0]]
    # What is behind the object must not bleed into its edge: colours are weighted by the mask.
    rgba[target][..., :3] = image[source]
    rgba[target][..., 3] = mask[source].view(np.uint8) * np.uint8(255)
    box = (*(low - first).tolist(), *(high - first).tolist())
    small = Image.fromarray(rgba).resize(size[::-1], Image.Resampling.BILINEAR, box=box)
    result = np.array(small)
    colours, inside = result[..., :3].copy(), result[..., 3] > 127
    colours[~inside] = schema.BACKGROUND_GREY
    return colours, inside


def move_points(
    points: np.ndarray, move: Move, intrinsics: np.ndarray, extrinsics: np.ndarray
) -> np.ndarray:
    """Points that follow a move of their image under the unchanged camera (the module's equation).

    Args:
      points: float32 [n, 3] in the project's frame, in front of the camera; n may be 0.
      move: of the image whose camera is given.
      intrinsics: [3, 3].
      extrinsics: [3, 4].

    Returns:
      float32 [n, 3]: `scale * points` plus one vector.
    """
    if not len(points):
        return points
    rotation, translation = extrinsics[:, :3].astype(np.float64), extrinsics[:, 3]
    centre_depth = _centre_depth(points, extrinsics)
    inverse = np.linalg.inv(intrinsics.astype(np.float64))
    (u, v) = (inverse @ move.matrix() @ intrinsics)[:2, 2]
    shift = centre_depth * np.array([u, v, 1 - move.scale])
    # R X' + T = s (R X + T) + shift
    offset = rotation.T @ ((move.scale - 1) * translation + shift)
    return points * np.float32(move.scale) + offset.astype(np.float32)


def move_depth(
    depth: np.ndarray, points: np.ndarray, move: Move, extrinsics: np.ndarray
) -> np.ndarray:
    """The depth map that follows a move of image and points: pixels moved, depths scaled about z0.

    Args:
      depth: float32 [h, w], 0 = none; each new pixel takes that of the nearest old one.
      points: float32 [n, 3], those of `move_points` before the move, n > 0.
      move: of the image.
      extrinsics: [3, 4].
    """
    height, width = depth.shape
    rows = np.floor((np.arange(height) + 0.5 - move.down) / move.scale).astype(np.intp)
    columns = np.floor((np.arange(width) + 0.5 - move.right) / move.scale).astype(np.intp)
    inside = ((rows >= 0) & (rows < height))[:, None] & (columns >= 0) & (columns < width)
    rows, columns = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
    moved = depth[rows[:, None], columns]
    centre = np.float32(_centre_depth(points, extrinsics))
    scaled = centre + np.float32(move.scale) * (moved - centre)
    return np.where(inside & (moved > 0), scaled, np.float32(0))


def _centre_depth(points: np.ndarray, extrinsics: np.ndarray) -> float:
    """z0: mean depth of the points along the optical axis."""
    return float(points.mean(axis=0, dtype=np.float64) @ extrinsics[2, :3] + extrinsics[2, 3])


def place(image: np.ndarray, mask: np.ndarray, *, move: bool = True) -> View:
    """Crops and scales an object to where training objects lie (the module's rule).

    Args:
      image: uint8 [h, w, 3] RGB.
      mask: bool [h, w], True on the object.
      move: False takes the whole image as the frame; it must be 4:3.

    Raises:
      PhotoError: no object in the mask, too little of it, or a frame that is not 4:3.
      ValueError: arrays of another dtype or shape.
    """
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"image is {image.dtype} {list(image.shape)}: accepted: uint8 [h, w, 3]")
    if mask.dtype != np.bool_ or mask.shape != image.shape[:2]:
        raise ValueError(
            f"mask is {mask.dtype} {list(mask.shape)}: accepted: bool {list(image.shape[:2])}"
        )
    height, width = VIEW_SIZE
    top, bottom, left, right = box_of(mask)
    if move:
        wide, high = right - left, bottom - top
        if max(wide, high) < SMALLEST_BOX:
            raise PhotoError(
                f"the object is {wide}x{high} pixels: accepted: {SMALLEST_BOX} or more"
            )
        to_view = rule_move((top, bottom, left, right)).matrix()
    else:
        if not same_proportions(image.shape[:2], VIEW_SIZE):
            raise PhotoError(
                f"the image is {image.shape[1]}x{image.shape[0]}: accepted as framed: 4:3, "
                f"such as {width}x{height}"
            )
        to_view = np.diag([width / image.shape[1], height / image.shape[0], 1.0])
    colours, inside = move_image(image, mask, to_view, VIEW_SIZE)
    if not inside.any():
        raise PhotoError("nothing of the object is left at the network's size")
    return View(colours, inside, *camera.default_camera(VIEW_SIZE), to_view, placed=move)


def normal_form(points: np.ndarray) -> tuple[float, np.ndarray]:
    """Scale a and shift b with `points = a * normalised + b`, where `normalised` has normal form.

    The form is that of training objects (`data_gen.meshes.normalize`): lowest point at z = 0,
    middle of the bounding box at x = y = 0, farthest point at distance 1 from the origin.

    Args:
      points: [..., 3], all clouds of one object; they get one scale and one shift.

    Returns:
      a > 0 (1 where all points are the same) and b, float64 [3].
    """
    flat = points.reshape(-1, 3).astype(np.float64)
    low, high = flat.min(axis=0), flat.max(axis=0)
    shift = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    scale = float(np.linalg.norm(flat - shift, axis=1).max())
    return scale or 1.0, shift


def normalised_extrinsics(extrinsics: np.ndarray, scale: float, shift: np.ndarray) -> np.ndarray:
    """The camera that sees normalised points where `extrinsics` sees the points themselves.

    `R (a X + b) + T` and `R X + (R b + T) / a` lie on the same ray; depths are divided by a.
    """
    rotation = extrinsics[:, :3].astype(np.float64)
    translation = (rotation @ shift + extrinsics[:, 3]) / scale
    return np.column_stack([rotation, translation]).astype(np.float32)
