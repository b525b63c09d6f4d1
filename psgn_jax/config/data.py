"""The section `data` of the configuration: the records, and how batches are made from them."""

import dataclasses
import os
import re
from typing import Annotated, Literal

from psgn_jax.config.structured import Bounds, Fraction
from psgn_jax.system.files import cache_folder

DEFAULT_DATA = "procedural-4-40"
"""Name of the default data set in the cache folder; `data_gen.default` renders it. Raise the first
number whenever its models or images change."""

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

    # Folders of records, separated by commas; their splits are joined. `FOLDER*N` counts the
    # folder's training samples N times, `~` is your home. Empty = the default data set.
    path: str = ""
    eval_path: str = ""  # Folders for evaluation, written like `path`; empty = the same as `path`.
    train_split: str = "train"  # Name of the split for training.
    eval_split: str = "validation"  # Name of the split for evaluation.
    # (height, width) of the network's input; images are resized to it. The network pads sides that
    # are not multiples of 2 ** (levels of `model.widths` - 1).
    image_size: tuple[Side, Side] = (192, 256)
    inputs: tuple[Channel, ...] = ("rgb", "mask")  # The network's input: "rgb", "mask", "depth".
    num_points: Points = 4096  # Number of true points drawn per sample and training step.
    num_eval_points: Points = 4096  # Number of true points per sample in an evaluation.
    flip: bool = False  # Whether to mirror half of the training samples (y to -y).
    # Largest relative change of width, uniform; not of samples with a rolled or skewed camera.
    stretch: Annotated[float, Bounds(low=0, high=0.9)] = 0.0
    # Largest relative change of scale by cropping; the factor is uniform in [1 - zoom, 1 + zoom].
    zoom: Annotated[float, Bounds(low=0, high=0.9)] = 0.0
    # Largest shift of that crop, as a fraction of the height and width of the image.
    shift: Annotated[float, Bounds(low=0, high=0.5)] = 0.0
    # Probability that the object of a training sample, with its points, is cropped and placed by
    # the rule of `data.framing`, like objects in photos (`augment.reframe`).
    place: Fraction = 0.0
    # Standard deviation of the logarithm of a random scale of image and points. The logarithm is
    # normally distributed and clipped at two standard deviations; the scale is reduced if the
    # object would leave the image. In the authors' images the standard deviation is 0.12.
    reframe_scale: Annotated[float, Bounds(low=0, high=0.3)] = 0.0
    # The same for random shifts of rows and columns, in image heights; the authors' have 0.07.
    reframe_shift: Annotated[float, Bounds(low=0, high=0.3)] = 0.0
    photo: PhotoEffects = dataclasses.field(default_factory=PhotoEffects)  # Effects of photos.
    # Strength of random changes of brightness, contrast and channel gains; 0 = off.
    colour_jitter: Fraction = 0.0
    # Number of processes that make training batches; 0 = threads in this process.
    num_workers: Annotated[int, Bounds(low=0, high=256)] = 0
    # GB of decoded samples that a training keeps in memory, in all its processes; 0 = none.
    cache_gb: Annotated[float, Bounds(low=0, high=1000)] = 0.5

    # Filled in from `task` and `voxels`; not keys of a configuration file.
    # Whether batches contain the solid volume.
    occupancy: bool = dataclasses.field(default=False, metadata=DERIVED)
    # Images of a model in a row of a training (at most) or evaluation batch; 0 = no axis of views.
    train_views: int = dataclasses.field(default=0, metadata=DERIVED)
    eval_views: int = dataclasses.field(default=0, metadata=DERIVED)
    # "place": evaluations place every sample by the rule of `data.framing`; "keep": unchanged.
    eval_frame: str = dataclasses.field(default="keep", metadata={"derived": "frame of evaluate"})

    @property
    def folders(self) -> tuple[str, ...]:
        """The folders in `path`, a folder with the factor N N times, or the default data set."""
        return _folders(self.path) or (str(cache_folder() / DEFAULT_DATA),)

    @property
    def eval_folders(self) -> tuple[str, ...]:
        """The folders for evaluation, without repetition."""
        return tuple(dict.fromkeys(_folders(self.eval_path) or self.folders))


def _folders(path: str) -> tuple[str, ...]:
    folders: list[str] = []
    parts = path.split(",")
    while parts:
        # A folder's name may contain up to 15 commas.
        joined = [_folder(",".join(parts[:end])) for end in range(1, min(len(parts), 16) + 1)]
        last = next((i for i, (name, _) in enumerate(joined) if os.path.isdir(name)), 0)
        name, factor = joined[last]
        folders += [name] * factor if name else []
        parts = parts[last + 1 :]
    return tuple(folders)


def _folder(part: str) -> tuple[str, int]:
    """The folder and the factor in `FOLDER*N`."""
    match = re.fullmatch(r"(.+?)\s*\*([1-9][0-9]{0,3})", part.strip())
    return os.path.expanduser(match[1] if match else part.strip()), int(match[2]) if match else 1
