"""The section `data` of the configuration: the records, and how batches are made from them."""

import dataclasses
import os
import re
from typing import Annotated, Literal

from psgn_jax.config.structured import Bounds, Fraction
from psgn_jax.system.files import cache_folder

DEFAULT_DATA = "procedural-3-40"
"""Folder of the default data set in the cache; `data_gen.default` renders it. Raise the first
number with every change of its models or images."""

DERIVED = {"derived": "data.image_size, data.inputs, task and voxels"}

Channel = Literal["rgb", "mask", "depth"]
Pixels = Annotated[float, Bounds(low=0, high=20)]
Points = Annotated[int, Bounds(low=1, high=200_000)]
Side = Annotated[int, Bounds(low=1, high=8192)]


@dataclasses.dataclass(frozen=True)
class PhotoEffects:
    """Effects of photos and their masks, added to training images (`data.effects`).

    0 disables an effect. Lengths are in pixels of an image with 192 rows.
    """

    # The mask is eroded or dilated by a length uniform in [-erode, dilate].
    erode: Pixels = 0.0
    dilate: Pixels = 0.0
    ragged: Pixels = 0.0  # Largest random displacement of the edge of the mask.
    # Probability of an occluder at an edge of the object's bounding box: an ellipse or a rectangle
    # with semi-axes of 10 to 30 % of the sides of the box, in half of the cases cut from the mask.
    occluders: Fraction = 0.0
    blur: Pixels = 0.0  # Largest standard deviation of a Gaussian blur.
    noise: Fraction = 0.0  # Largest standard deviation of Gaussian noise, 1 = full range.
    jpeg: Fraction = 0.0  # Strength of JPEG: the quality is uniform in [100 - 90 * jpeg, 100].
    # Largest relative change of the red and the blue channel.
    white_balance: Annotated[float, Bounds(low=0, high=0.9)] = 0.0
    # Largest change of exposure, in stops (factors of two).
    exposure: Annotated[float, Bounds(low=0, high=4)] = 0.0

    def any(self) -> bool:
        return any(getattr(self, field.name) for field in dataclasses.fields(self))


@dataclasses.dataclass(frozen=True)
class DataConfig:
    """The records, and how batches are made from them."""

    # Folders of records, separated by commas, whose splits are joined; empty = the default data
    # set, rendered on first use. With `FOLDER*N`, its training samples count N times. `~` is your
    # home.
    path: str = ""
    eval_path: str = ""  # Folders for evaluation, in the same form; empty = as `path`.
    train_split: str = "train"  # Name of the split for training.
    eval_split: str = "validation"  # Name of the split that is evaluated during training.
    # (height, width) of the network's input; images are resized to it. The network pads sides that
    # are not multiples of 2 ** (levels of `model.widths` - 1).
    image_size: tuple[Side, Side] = (192, 256)
    inputs: tuple[Channel, ...] = ("rgb", "mask")  # Of the network: "rgb", "mask" and "depth".
    num_points: Points = 4096  # Number of true points drawn per sample and training step.
    num_eval_points: Points = 4096  # Number of true points per sample in an evaluation.
    flip: bool = False  # Whether to mirror half of the training samples (y to -y).
    # Largest relative change of width; the factor is uniform in [1 - stretch, 1 + stretch]. Samples
    # with a rolled or skewed camera are not changed.
    stretch: Annotated[float, Bounds(low=0, high=0.9)] = 0.0
    # Largest relative change of scale by cropping; the factor is uniform in [1 - zoom, 1 + zoom].
    zoom: Annotated[float, Bounds(low=0, high=0.9)] = 0.0
    # Largest shift of that crop, as a fraction of the height and width of the image.
    shift: Annotated[float, Bounds(low=0, high=0.5)] = 0.0
    # Probability that the object of a training sample is cropped and placed by the rule of
    # `data.framing`, like objects in photos, with its points (`augment.reframe`).
    place: Fraction = 0.0
    # Standard deviation of the logarithm of a further random scale of image and points; it is
    # normally distributed, clipped at two standard deviations, and reduced if the object would
    # leave the image. In the authors' images it is 0.12.
    reframe_scale: Annotated[float, Bounds(low=0, high=0.3)] = 0.0
    # Likewise of a random shift along rows and columns, as a fraction of the image height; there
    # it is 0.07.
    reframe_shift: Annotated[float, Bounds(low=0, high=0.3)] = 0.0
    photo: PhotoEffects = dataclasses.field(default_factory=PhotoEffects)  # Effects of photos.
    # Strength of random changes of brightness, contrast and channel gains; 0 = off.
    colour_jitter: Fraction = 0.0
    # Number of processes that make training batches; 0 = threads in this process.
    num_workers: Annotated[int, Bounds(low=0, high=256)] = 0
    # GB of decoded samples that a training keeps in memory, over all its processes; 0 = none.
    cache_gb: Annotated[float, Bounds(low=0, high=1000)] = 0.5

    # Filled in from `task` and `voxels`; not keys of a configuration file.
    # Whether batches contain the solid volume.
    occupancy: bool = dataclasses.field(default=False, metadata=DERIVED)
    # Images of the same model in each row of a training batch (at most) or an evaluation batch;
    # 0 = one image, without an axis of views.
    train_views: int = dataclasses.field(default=0, metadata=DERIVED)
    eval_views: int = dataclasses.field(default=0, metadata=DERIVED)
    # "place" = evaluations place every sample as `place` does; "keep" = unchanged.
    eval_frame: str = dataclasses.field(default="keep", metadata={"derived": "frame of evaluate"})

    @property
    def folders(self) -> tuple[str, ...]:
        """The folders in `path`, those with a factor N N times; or the default data set."""
        return _folders(self.path) or (str(cache_folder() / DEFAULT_DATA),)

    @property
    def eval_folders(self) -> tuple[str, ...]:
        """The folders for evaluation, each once."""
        return tuple(dict.fromkeys(_folders(self.eval_path) or self.folders))


def _folders(path: str) -> tuple[str, ...]:
    folders: list[str] = []
    parts = path.split(",")
    while parts:
        # The name of a folder may contain commas, at most 15.
        joined = [_folder(",".join(parts[:end])) for end in range(1, min(len(parts), 16) + 1)]
        last = next((i for i, (name, _) in enumerate(joined) if os.path.isdir(name)), 0)
        name, factor = joined[last]
        folders += [name] * factor if name else []
        parts = parts[last + 1 :]
    return tuple(folders)


def _folder(part: str) -> tuple[str, int]:
    """A folder and its factor; `~` is the user's home."""
    match = re.fullmatch(r"(.+?)\s*\*([1-9][0-9]{0,3})", part.strip())
    return os.path.expanduser(match[1] if match else part.strip()), int(match[2]) if match else 1
