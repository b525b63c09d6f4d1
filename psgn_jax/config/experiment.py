"""The configuration: frozen dataclasses, and checks that involve several fields.

`parse` converts an `ml_collections.ConfigDict` or any nested mapping to a `Config`. The dataclasses
here and in `config.data` define all fields. Lengths are in the project's unit, the radius of the
object's bounding hemisphere; image sizes are (height, width) in pixels.
"""

import dataclasses
import json
import os
import pathlib
from collections.abc import Iterable
from typing import Annotated, Any, Literal

from psgn_jax.config import structured
from psgn_jax.config.data import DERIVED, DataConfig
from psgn_jax.config.structured import (
    Bounds,
    ConfigError,
    Count,
    Fraction,
    NonNegative,
    Positive,
    PositiveInt,
    Size,
    build,
    to_dict,
)
from psgn_jax.system.untrusted import parse_json, with_checksum, without_checksum

# Decay rates of Adam and of the parameter average; at 1, an average would never change.
Decay = Annotated[float, Bounds(low=0, high=1, open_high=True)]
Factor = Annotated[float, Bounds(low=0, high=100, open_low=True)]
Task = Literal["points", "refiner", "volume", "views"]
# Number of channels of each input, see `models.networks.stack_channels`.
_CHANNELS = {"rgb": 3, "mask": 1, "depth": 2}


@dataclasses.dataclass(frozen=True)
class ModelConfig:
    """The network (paper, section "Point Set Prediction Network"); defaults: the published one."""

    name: str = "two_branch"  # or "vanilla", "hourglass": a name in `models.networks.NETWORKS`
    # Feature maps at each resolution level, full size first; each level halves the size.
    widths: tuple[Size, ...] = (16, 32, 64, 128, 256, 512, 512)
    # Number of points of the fully connected (fc) branch; with `vanilla`, of the cloud.
    fc_points: Annotated[int, Bounds(low=0, high=1_000_000)] = 256
    # Level at which the deconv branch ends (3 = an eighth of the image size).
    deconv_level: Count = 3
    deconv_channels: Size = 3  # Output channels of the deconv branch, 3 for each point of a cell.
    fc_widths: tuple[Size, ...] = (2048, 1024)  # Hidden widths of the fully connected branch.
    # Dimension of the random input r; 0 = none.
    random_size: Annotated[int, Bounds(low=0, high=1_000_000)] = 0
    # Where r enters: "bottleneck", as in the paper, or "all": also the hidden layer of the fc
    # branch and the levels of the deconv branch (**ours**), as a shift of features, initially 0.
    random_at: Literal["bottleneck", "all"] = "bottleneck"
    # Whether to train a conditional variational autoencoder. In training, r is drawn from the
    # distribution that the posterior network predicts from the ground truth (`models.posterior`);
    # in evaluation and prediction, from the prior N(0, I).
    posterior: bool = False
    # Feature maps of the posterior network's 3D convolutions; each halves the 32^3 grid.
    posterior_widths: tuple[Size, ...] = (32, 64, 128)
    posterior_hidden: Size = 128  # Width of the posterior network's dense layer.
    # Dtype of the arithmetic in the network; parameters are always float32.
    compute_dtype: Literal["float32", "bfloat16"] = "float32"

    # Filled in from `data`; not keys of a configuration file.
    image_size: tuple[int, int] = dataclasses.field(default=(192, 256), metadata=DERIVED)
    in_channels: int = dataclasses.field(default=4, metadata=DERIVED)

    @property
    def divisor(self) -> int:
        """The network pads both image sides to multiples of this."""
        return 2 ** (len(self.widths) - 1)


@dataclasses.dataclass(frozen=True)
class LossConfig:
    """What training minimises (paper, section "Distance Metric between Point Sets")."""

    # An entry of `losses.LOSSES`, or a weighted sum such as "emd_mean@1024 + 5*chamfer_sq_mean",
    # where 1024 is the number of true points (`losses.by_name`).
    name: str = "chamfer_sq_mean"
    # "authors" adds the L2 terms of `tasks.points.l2_authors`.
    l2: Literal["none", "authors"] = "none"
    emd_tolerance: Positive = 0.01  # Accepted relative error of the assignment in an EMD.
    # Number of draws of the random input for each sample and training step. Only the draw nearest
    # to the truth counts (`losses.min_of_n`); 2 in the paper. Evaluation uses one draw.
    min_of_n: Annotated[int, Bounds(low=1, high=1000)] = 1
    # With `min_of_n` > 1, how the nearest draw is chosen. 0: by the loss of every draw, as in the
    # paper. k > 0: by the Chamfer distance of k points of each cloud. The loss is then computed for
    # the chosen draw only, so a step with 8 draws costs little more than with one.
    winner_points: Count = 0
    # Weight of the mean Chamfer distance over all draws, against implausible draws (**ours**; needs
    # `winner_points`). Each step computes the distance of the first draw, an unbiased estimate.
    mean_weight: NonNegative = 0.0
    # With `model.posterior`: weight of the Kullback-Leibler divergence from the prior, in units of
    # the loss per nat. In the variational bound it is 1 if the loss is -log p of the truth, and
    # 2 sigma^2 for a sum of squared distances of points with the standard deviation sigma.
    kl_weight: NonNegative = 1.0
    kl_warmup_steps: Count = 0  # Number of first steps in which the weight rises linearly from 0.


@dataclasses.dataclass(frozen=True)
class OptimConfig:
    """Adam and its schedule."""

    learning_rate: Positive = 3e-5  # The peak; 3e-5 is the authors' value.
    # After the warm-up, constant, or half a cosine down to `final_fraction` of the peak.
    schedule: Literal["constant", "cosine"] = "constant"
    warmup_steps: Count = 0  # Number of steps of a linear warm-up from 0.
    final_fraction: Fraction = 0.0  # Last learning rate as a fraction of the peak (cosine only).
    b1: Decay = 0.9  # Adam's decay rate of the mean gradient.
    b2: Decay = 0.999  # Adam's decay rate of the mean squared gradient.
    eps: Positive = 1e-8  # Adam's epsilon.
    clip_norm: NonNegative = 0.0  # Largest global norm of the gradient; 0 = no clipping.
    # Decay per step of the averaged parameters, which evaluation uses; 0 = no average. The decay of
    # step t = 0, 1, ... is the smaller of `ema_decay` and (t + 1) / (t + 10).
    ema_decay: Decay = 0.0


@dataclasses.dataclass(frozen=True)
class TrainConfig:
    """Length of the training and intervals of its output; 0 disables an output."""

    batch_size: Size = 32  # Samples per step, over all devices and processes.
    steps: PositiveInt = 300_000  # Total number of updates; 300,000 in the paper.
    log_every: PositiveInt = 100  # Steps between lines of metrics.
    eval_every: Count = 5_000  # Steps between evaluations on `data.eval_split`; also at the end.
    checkpoint_every: Count = 1_000  # Steps between checkpoints; also at evaluations, at the end.
    # Steps between images of predictions in TensorBoard; also at the end.
    images_every: Count = 5_000
    keep_checkpoints: PositiveInt = 2  # Number of newest checkpoints kept, besides the best.
    # Seconds after SIGTERM or Ctrl-C in which the current step may end and be saved. Then the
    # process ends, after it has completed a checkpoint that is being written.
    stop_seconds: NonNegative = 20.0
    # Initial parameters: a file of weights, the name of weights in the package, or the folder of a
    # trained run (its best checkpoint); the mean of several, separated by commas. Empty = random.
    init: str = ""
    # Name patterns of layers that keep random initial parameters; `*` matches any text.
    init_skip: tuple[str, ...] = ()

    @property
    def networks(self) -> list[str]:
        """The names in `init`; the path of one network may contain commas."""
        if os.path.exists(os.path.expanduser(self.init)):
            return [self.init]
        return [name.strip() for name in self.init.split(",")] if self.init else []


@dataclasses.dataclass(frozen=True)
class EvalConfig:
    """Evaluation, during training and afterwards."""

    batch_size: Size = 32  # Samples per step.
    max_samples: Count = 0  # In training, only so many first samples are evaluated; 0 = all.
    fscore_threshold: Positive = 0.01  # Distance in units below which a point is correct.
    # Accepted relative error of the EMD to as many true as predicted points; 0 = no EMD.
    emd_tolerance: NonNegative = 0.01
    # A true point is visible if a surface point of the depth image is within this distance, in
    # units (`data.visibility`); 0, or records without depth: no metrics of visible points.
    visible_tolerance: Annotated[float, Bounds(low=0, high=0.1)] = 0.025
    # Whether training, too, measures the distances after the best scale and shift of each cloud
    # (`evaluation.aligned`, with a second EMD). `psgn evaluate` always does.
    aligned: bool = False
    # Whether to measure the clouds of `psgn predict`: averaged with the mirror image's cloud and
    # fitted to the mask (`prediction.refine`), for r = 0. Only for the task "points".
    refine: bool = False


@dataclasses.dataclass(frozen=True)
class VoxelConfig:
    """Settings of the tasks on solid volumes; each comment begins with the task that reads it."""

    # "refiner": folder of a run trained with the CD, whose clouds are an input; required without
    # `from_emd`. When the refiner starts, it copies the run's best checkpoint into its folder.
    from_cd: str = ""
    from_emd: str = ""  # "refiner": the same for a run trained with the EMD.
    from_volume: str = ""  # "refiner": folder of a run of the task "volume", a further input.
    widths: tuple[Size, Size, Size, Size, Size] = (16,) * 5  # "refiner": widths of hidden layers.
    width_multiplier: Factor = 1.0  # "views": factor of all widths.
    # "views": a training batch has 1 to `max_views` views of each model, drawn for each batch.
    max_views: Annotated[int, Bounds(low=1, high=1000)] = 5
    # "views": numbers of views in an evaluation; the first chooses the best checkpoint.
    eval_views: tuple[PositiveInt, ...] = (1, 3, 5)

    @property
    def sources(self) -> dict[str, str]:
        """Field name -> folder of a run that the refiner reads, without empty fields."""
        names = ("from_cd", "from_emd", "from_volume")
        return {name: getattr(self, name) for name in names if getattr(self, name)}


@dataclasses.dataclass(frozen=True)
class Config:
    """Everything that a run depends on."""

    # Seed of all random numbers; JAX uses only the lowest 32 bits.
    seed: Annotated[int, Bounds(low=0, high=2**63 - 1)] = 0
    data: DataConfig = dataclasses.field(default_factory=DataConfig)
    model: ModelConfig = dataclasses.field(default_factory=ModelConfig)
    loss: LossConfig = dataclasses.field(default_factory=LossConfig)
    optim: OptimConfig = dataclasses.field(default_factory=OptimConfig)
    train: TrainConfig = dataclasses.field(default_factory=TrainConfig)
    eval: EvalConfig = dataclasses.field(default_factory=EvalConfig)
    # "points" predicts a cloud from an image. The others train on the solid volumes of the records:
    # "refiner" predicts an occupancy grid from the clouds of trained networks, "volume" the volume
    # of the object (a number) from an image, "views" (3D-R2N2) a grid from one or more images.
    task: Task = "points"
    voxels: VoxelConfig = dataclasses.field(default_factory=VoxelConfig)


def parse(config: Any) -> Config:
    """Converts an `ml_collections.ConfigDict` or a nested mapping; missing keys have defaults.

    Errors: as `structured.build`, and `ConfigError` if fields contradict each other.
    """
    parsed = build(Config, config)
    views, voxels = parsed.task == "views", parsed.voxels
    data = dataclasses.replace(
        parsed.data,
        occupancy=parsed.task != "points",
        train_views=voxels.max_views if views else 0,
        eval_views=max(voxels.eval_views, default=0) if views else 0,
    )
    channels = sum(_CHANNELS[name] for name in data.inputs)
    model = dataclasses.replace(parsed.model, image_size=data.image_size, in_channels=channels)
    parsed = dataclasses.replace(parsed, data=data, model=model)
    _check_together(parsed)
    return parsed


_LOSS = tuple(f"loss.{field.name}" for field in dataclasses.fields(LossConfig))
_NEEDS: tuple[structured.Need, ...] = (
    ("task='points'", lambda config: config.task == "points",
     ("model.posterior", "model.random_size", "eval.aligned", *_LOSS)),
    ("model.random_size > 0", lambda config: config.model.random_size, ("model.random_at",)),
    ("model.posterior=True", lambda config: config.model.posterior,
     ("loss.kl_weight", "loss.kl_warmup_steps", "model.posterior_widths",
      "model.posterior_hidden")),
    ("loss.name has an EMD", lambda config: "emd" in config.loss.name, ("loss.emd_tolerance",)),
    ("optim.schedule='cosine'", lambda config: config.optim.schedule == "cosine",
     ("optim.final_fraction",)),
    ("task='refiner'", lambda config: config.task == "refiner",
     ("voxels.from_cd", "voxels.from_emd", "voxels.from_volume", "voxels.widths")),
    ("task='views'", lambda config: config.task == "views",
     ("voxels.width_multiplier", "voxels.max_views", "voxels.eval_views")),
)  # fmt: skip


def check_used(config: Config, names: Iterable[str]) -> None:
    """Raises `ConfigError` if a field in `names` was changed but has no effect."""
    structured.check_used(config, _NEEDS, set(names))


def check_paths(config: Config, *, training: bool = True, hint: str = "") -> None:
    """Raises `ConfigError` if a folder for evaluation, or for `training` too, is missing."""
    data, named = config.data, []
    if data.path and (training or not data.eval_path):
        named.append(("path", data.folders, "the default data set"))
    if data.eval_path:
        named.append(("eval_path", data.eval_folders, "the folders of data.path"))
    for name, folders, empty in named:
        for path in dict.fromkeys(folders):
            if not pathlib.Path(path).is_dir():
                what = "is not a folder" if os.path.exists(path) else "does not exist"
                raise ConfigError(
                    f"data.{name}={path!r} {what}; accepted: folders of records, separated by "
                    f"commas, or '' for {empty}{hint and f'; {hint}'}"
                )


def to_json(config: Config) -> str:
    """The configuration as the text of `config.json`, with a checksum."""
    return json.dumps(with_checksum(to_dict(config)), indent=2) + "\n"


class DamagedError(ConfigError):
    """A stored configuration is not JSON, or its checksum does not match."""


def from_json(text: str) -> Config:
    """The inverse of `to_json`; `DamagedError` for damaged text, `ConfigError` for wrong fields."""
    try:
        stored = without_checksum(parse_json(text))
    except ValueError as error:
        raise DamagedError(f"damaged: {error}") from None
    return parse(stored)


def _check_together(config: Config) -> None:
    """Checks of several fields, and checks that annotations cannot express."""
    data, model, loss, voxels = config.data, config.model, config.loss, config.voxels
    task, steps, deepest = config.task, config.train.steps, len(model.widths) - 2
    levels = f"(model.widths has {deepest + 2} levels)"
    deconv = model.name in ("two_branch", "hourglass")
    on_volumes, views, counts = task != "points", task == "views", voxels.eval_views
    # Smaller images would consist mostly of padding (to multiples of the divisor).
    smallest = max(8, model.divisor // 2)
    structured.check_rules(config, [
        ("data.inputs", len(set(data.inputs)) < len(data.inputs) or "rgb" not in data.inputs,
         "'rgb' and any of 'mask', 'depth', each once"),
        ("model.widths", len(model.widths) < 2, "at least two resolution levels"),
        ("data.image_size", min(data.image_size) < smallest,
         f"(height, width) of at least {smallest} pixels each {levels}; multiples of "
         f"{model.divisor} need no padding"),
        ("model.fc_widths", model.fc_points and not model.fc_widths,
         "at least one width, such as (1024,)"),
        ("model.deconv_level", deconv and model.deconv_level > deepest, f"0 to {deepest} {levels}"),
        ("model.deconv_channels", deconv and model.deconv_channels % 3, "a multiple of 3"),
        ("model.fc_points", model.name == "vanilla" and not model.fc_points,
         "at least 1 (all the points of 'vanilla')"),
        ("loss.min_of_n", loss.min_of_n > 1 and not model.random_size,
         "1, since without a random input (model.random_size=0) all draws are equal"),
        ("model.random_size", model.posterior and not model.random_size,
         "at least 1 with model.posterior=True"),
        ("loss.min_of_n", model.posterior and loss.min_of_n > 1,
         "1 with model.posterior=True, which draws r once per sample, given the truth"),
        ("loss.winner_points", loss.winner_points and loss.min_of_n == 1,
         "0 with loss.min_of_n=1, which has no draws to choose from"),
        ("loss.mean_weight", loss.mean_weight and not loss.winner_points,
         "0 with loss.winner_points=0"),
        ("model.posterior_widths", model.posterior and not 1 <= len(model.posterior_widths) <= 5,
         "1 to 5 widths"),
        ("train.init_skip", config.train.init_skip and not config.train.init,
         "() without train.init"),
        ("optim.warmup_steps", config.optim.warmup_steps >= steps,
         f"fewer than train.steps={steps} (a shorter run needs both)"),
        *((f"data.{name}", on_volumes and getattr(data, name),
           f"0 with task={task!r} (volumes are not transformed)")
          for name in ("stretch", "place", "reframe_scale", "reframe_shift")),
        ("loss.l2", on_volumes and loss.l2 != "none", f"'none' with task={task!r}"),
        ("eval.refine", on_volumes and config.eval.refine, f"False with task={task!r}"),
        ("voxels.from_cd", task == "refiner" and not (voxels.from_cd or voxels.from_emd),
         "the folder of a trained run (or voxels.from_emd)"),
        ("data.image_size",
         task == "volume" and any(side % model.divisor for side in data.image_size),
         f"multiples of {model.divisor} for 'volume'"),
        ("data.inputs", views and "depth" in data.inputs, "'rgb' and 'mask' with task='views'"),
        ("data.zoom", views and data.zoom, "0 with task='views'"),
        ("data.shift", views and data.shift, "0 with task='views'"),
        ("voxels.eval_views", views and (not counts or len(set(counts)) < len(counts)),
         "numbers of views, each once"),
    ])  # fmt: skip


def require_points_task(config: Config, what: str) -> None:
    """Raises `ConfigError` if the run does not predict points, which `what` needs."""
    if config.task != "points":
        raise ConfigError(f"task={config.task!r}: {what} expects a run of the task 'points'")
