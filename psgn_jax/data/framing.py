"""The position of an object in the image: one rule for training, evaluation and prediction.

**Training objects.** The authors scale each object to a bounding hemisphere of radius 1 and use one
camera, so an object's proportions determine its position in the image. In their 1,504 images
(192x256), the bounding box of the mask, `h` x `w` pixels, is near the curve

    (w / 223)^4 + (h / 124)^4 = 1

(standard deviation of the scale 12 %), with its centre at column 128 (sd 11) and row 63 + 0.224 w
(sd 14). We fitted this by least squares to the images whose boxes have sides of at least 20 pixels.
`rule_move` maps an object's box to this curve and this centre.

**Images and points together.** A photo determines neither the size nor the position of its object.
If we move a training image, from column and row `p` to `s p + (right, down)`, we therefore move its
points as well, and keep the camera (K, R, T). In the frame of the camera, rays `q = (x, y) / z`
become `s q + (u, v)`, where (u, v, 1) is the last column of
`K^-1 [[s, 0, right], [0, s, down], [0, 0, 1]] K`. We scale the object about its centre, whose depth
`z0` is the mean over the points, and move it perpendicular to the optical axis:

    X' = s X + z0 (u, v, 1 - s)

This keeps the shape and the angle to the ground; an exact move would shear the object. The
projection of a point at depth `z0 + d` is wrong by

    q' - (s q + (u, v)) = s d / (z0 + s d) * ((1 - s) q - (u, v))

times the focal length in pixels: 1.2 pixels (root mean square) for a box of 1 x 1.2 x 0.7 under a
shift by 14 pixels with the authors' camera.
"""

import dataclasses

import numpy as np
from PIL import Image

from psgn_jax.data import camera, schema
from psgn_jax.data.camera import VIEW_SIZE
from psgn_jax.data.photo import PhotoError, same_proportions
from psgn_jax.data.resample import box_of, on_mask

BOX_WIDTH, BOX_HEIGHT, BOX_POWER = 223.0, 124.0, 4
MIDDLE_COLUMN, MIDDLE_ROW, MIDDLE_ROW_PER_WIDTH = 128.0, 63.0, 0.224

SMALLEST_BOX = 8
"""An object is not placed if the longer side of its box has fewer pixels."""

LARGEST_CHANGE = 2.0
"""A sample is not placed if its size would change by more than this factor: its mask shows little
of the object, such as a plate seen edge-on."""

_LARGE_VIEW = 1 << 24  # pixels
_THINNEST = 0.5  # pixels of the view; a thinner object covers less than half of each pixel
_VANISHES = "the object vanishes at the resolution of the network; expected a larger one"


@dataclasses.dataclass(frozen=True)
class Move:
    """Maps (column, row) to `scale * (column, row) + (right, down)`; pixels as in `schema`."""

    scale: float
    right: float
    down: float

    def matrix(self) -> np.ndarray:
        """float64 [3, 3] on homogeneous (column, row)."""
        return np.array([[self.scale, 0, self.right], [0, self.scale, self.down], [0, 0, 1.0]])

    def then(self, other: "Move") -> "Move":
        """This move first, then `other`."""
        return Move(
            other.scale * self.scale,
            other.scale * self.right + other.right,
            other.scale * self.down + other.down,
        )


@dataclasses.dataclass(frozen=True, eq=False)
class Framed:
    """A photo framed for a network, with the authors' camera for this view.

    `to_view` maps homogeneous (column, row) of the photo to (column, row) of the view, so
    `inv(to_view) @ intrinsics` is the photo's camera.
    """

    image: np.ndarray  # uint8 [h, w, 3] at the network's size, grey outside the mask
    mask: np.ndarray  # bool [h, w]
    intrinsics: np.ndarray  # [3, 3]
    extrinsics: np.ndarray  # [3, 4]
    to_view: np.ndarray  # float64 [3, 3]
    placed: bool  # False if the photo's framing was kept


def is_framed(image: np.ndarray) -> bool:
    """Whether an image is framed like training images: 4:3, with a border of grey 191."""
    if not same_proportions(image.shape[:2], VIEW_SIZE):
        return False
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]]).astype(int)
    near = np.abs(border - schema.BACKGROUND_GREY).max(axis=1) <= 1
    return bool(near.mean() > 0.97)


def padding(size: tuple[int, int], target: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    """Rows (above, below) and columns (left, right) to add to an image of `size` (H, W).

    An image that has neither the proportions of the view nor of the network's input, `target`, gets
    those of the view: its object is not squeezed, as in a prediction.
    """
    if any(same_proportions(size, other) for other in (VIEW_SIZE, target)):
        return (0, 0), (0, 0)
    rows = max(0, round(size[1] * VIEW_SIZE[0] / VIEW_SIZE[1]) - size[0])
    columns = max(0, round(size[0] * VIEW_SIZE[1] / VIEW_SIZE[0]) - size[1])
    return (rows // 2, rows - rows // 2), (columns // 2, columns - columns // 2)


def rule_move(box: tuple[float, float, float, float]) -> Move:
    """The move that places a box (top, bottom, left, right) by the rule, in 192x256 pixels."""
    top, bottom, left, right = box
    wide, high = right - left, bottom - top
    relative = (wide / BOX_WIDTH) ** BOX_POWER + (high / BOX_HEIGHT) ** BOX_POWER
    scale = relative ** (-1 / BOX_POWER)
    row = MIDDLE_ROW + MIDDLE_ROW_PER_WIDTH * wide * scale
    across = MIDDLE_COLUMN - scale * (left + right) / 2
    return Move(scale, across, row - scale * (top + bottom) / 2)


def rule_move_within(mask: np.ndarray) -> Move | None:
    """The move that places a mask [h, w] by the rule, in pixels of the mask.

    The mask shows the whole view of 192x256. None if the object is too small or would change by
    more than `LARGEST_CHANGE`.
    """
    top, bottom, left, right = box_of(mask) if mask.any() else (0, 0, 0, 0)
    if max(bottom - top, right - left) < SMALLEST_BOX:
        return None
    down, across = VIEW_SIZE[0] / mask.shape[0], VIEW_SIZE[1] / mask.shape[1]
    move = rule_move_of((top * down, bottom * down, left * across, right * across))
    return move and Move(move.scale, move.right / across, move.down / down)


def rule_move_of(box: tuple[float, float, float, float]) -> Move | None:
    """`rule_move`; None if the box is a point or would change by more than `LARGEST_CHANGE`."""
    top, bottom, left, right = box
    if max(bottom - top, right - left) <= 0:
        return None
    move = rule_move(box)
    return move if 1 / LARGEST_CHANGE <= move.scale <= LARGEST_CHANGE else None


def has_authors_angle(extrinsics: np.ndarray) -> bool:
    """Whether a camera has the authors' elevation and roll, up to .6 degrees."""
    _, authors = camera.default_camera(VIEW_SIZE)
    return bool(np.abs(extrinsics[:, :3] - authors[:, :3]).max() < 0.01)


def box_from_authors_angle(points: np.ndarray) -> tuple[float, float, float, float]:
    """The box of points [n, 3] in the authors' view of 192x256 pixels."""
    pixels, _ = camera.project(points, *camera.default_camera(VIEW_SIZE))
    (left, top), (right, bottom) = pixels.min(axis=0).tolist(), pixels.max(axis=0).tolist()
    return top, bottom, left, right


def keep_inside(move: Move, mask: np.ndarray) -> Move:
    """The move, with scale and shift reduced so that the object stays inside the array [h, w]."""
    top, bottom, left, right = box_of(mask)
    (height, width), scale = mask.shape, move.scale
    scale = min(scale, height / (bottom - top), width / (right - left))
    # With the reduced scale, the centre of the box moves to the same position.
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
    """Resamples image uint8 [h, w, 3] and mask bool [h, w] to a view of `size` (H, W).

    `to_view` [3, 3] maps (column, row) of the array to the view, by scale and shift. The result is
    grey 191 outside its mask. Pillow's bilinear filter is antialiased when it reduces an image.
    """
    # The view's corners in the array. Parts of the view outside the array are grey.
    factors = 1 / np.diag(to_view)[:2]
    corner, shape = -to_view[:2, 2] * factors, np.array(image.shape[1::-1])
    begin, end = np.zeros(2, int), np.array(size[::-1])
    if np.prod(end * factors) > _LARGE_VIEW:
        # Only the part that shows the array, and its border. The filter then rounds differently.
        begin = np.clip(np.floor(-corner / factors) - 2, begin, end).astype(int)
        end = np.clip(np.ceil((shape - corner) / factors) + 2, begin, end).astype(int)
    low, high = corner + begin * factors, corner + end * factors
    first, last = np.floor(low).astype(int), np.ceil(high).astype(int)
    rgba = np.full((last[1] - first[1], last[0] - first[0], 4), schema.BACKGROUND_GREY, np.uint8)
    rgba[..., 3] = 0
    start, stop = np.maximum(first, 0), np.minimum(last, shape)
    source = np.s_[start[1] : stop[1], start[0] : stop[0]]
    target = np.s_[
        start[1] - first[1] : stop[1] - first[1], start[0] - first[0] : stop[0] - first[0]
    ]
    # Colours are weighted by the mask, so that edges contain no background.
    rgba[target][..., :3] = image[source]
    rgba[target][..., 3] = mask[source].astype(np.uint8) * np.uint8(255)
    box = (*(low - first).tolist(), *(high - first).tolist())
    part = Image.fromarray(rgba).resize(tuple(end - begin), Image.Resampling.BILINEAR, box=box)
    result = np.zeros((*size, 4), np.uint8)
    result[begin[1] : end[1], begin[0] : end[0]] = np.asarray(part)
    colours, inside = np.ascontiguousarray(result[..., :3]), result[..., 3] > 127
    return on_mask(inside, colours, np.uint8(schema.BACKGROUND_GREY)), inside


def move_points(
    points: np.ndarray, move: Move, intrinsics: np.ndarray, extrinsics: np.ndarray
) -> np.ndarray:
    """Moves points [n, 3] together with the image of their camera, by the module's equation."""
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
    """Moves a depth map [h, w] (0 = none) by nearest pixels, and scales its depths about z0.

    `points` are the points before `move_points`.
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
    """z0 of the module: the points' mean depth."""
    return float(points.mean(axis=0, dtype=np.float64) @ extrinsics[2, :3] + extrinsics[2, 3])


def place(
    image: np.ndarray, mask: np.ndarray, size: tuple[int, int] = VIEW_SIZE, *, move: bool = True
) -> Framed:
    """Places the object of an image uint8 [h, w, 3] with mask bool [h, w] by the module's rule.

    Args:
      size: (H, W) of the view, the network's input.
      move: False keeps the image's framing, which must then be 4:3.

    `PhotoError` if the mask is empty or full, the object too small, or the framing not 4:3.
    """
    height, width = size
    if not mask.any():
        raise PhotoError("the mask is empty; expected pixels of an object")
    if mask.all():
        raise PhotoError("the mask covers the whole image; expected the pixels of an object")
    if move:
        top, bottom, left, right = box_of(mask)
        wide, high = right - left, bottom - top
        if max(wide, high) < SMALLEST_BOX:
            raise PhotoError(
                f"the object is {wide}x{high} pixels: accepted: a longer side of {SMALLEST_BOX} or "
                "more"
            )
        to_view = rule_move((top, bottom, left, right)).matrix()
        to_view = np.diag([width / VIEW_SIZE[1], height / VIEW_SIZE[0], 1.0]) @ to_view
        if min(wide * to_view[0, 0], high * to_view[1, 1]) < _THINNEST:
            raise PhotoError(_VANISHES)
    else:
        if not same_proportions(image.shape[:2], VIEW_SIZE):
            raise PhotoError(
                f"the image is {image.shape[1]}x{image.shape[0]}: accepted without cropping: 4:3, "
                "such as 256x192"
            )
        to_view = np.diag([width / image.shape[1], height / image.shape[0], 1.0])
    colours, inside = move_image(image, mask, to_view, size)
    if not inside.any():
        raise PhotoError(_VANISHES)
    return Framed(colours, inside, *camera.default_camera(size), to_view, placed=move)


def normal_form(points: np.ndarray) -> tuple[float, np.ndarray]:
    """Scale a > 0 and shift b [3] with `points = a * normalised + b`, for points [..., 3].

    `normalised` is like training objects (`data_gen.frame.normalize`): the lowest point is at z =
    0, the centre of the bounding box at x = y = 0, and the farthest point at distance 1 from the
    origin. a is 1 if all points are equal.
    """
    flat = points.reshape(-1, 3).astype(np.float64)
    low, high = flat.min(axis=0), flat.max(axis=0)
    shift = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    scale = float(np.linalg.norm(flat - shift, axis=1).max())
    return scale or 1.0, shift


def normalised_extrinsics(extrinsics: np.ndarray, scale: float, shift: np.ndarray) -> np.ndarray:
    """The camera that projects normalised points to the pixels of the original points.

    `R (a X + b) + T` and `R X + (R b + T) / a` are on one ray; depths are divided by a.
    """
    rotation = extrinsics[:, :3].astype(np.float64)
    translation = (rotation @ shift + extrinsics[:, 3]) / scale
    return np.column_stack([rotation, translation]).astype(np.float32)
