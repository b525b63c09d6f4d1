"""Tasks on solid volumes: the refiner of clouds, the object's volume, and 3D-R2N2.

All three read the records' occupancy, a 32^3 grid in the frame of the image; IoU is that of
`losses.iou`. The threshold at which a probability counts as occupied is the one, of .05 to .95,
with the best mean IoU over the samples of the split on which a run is evaluated while it trains; a
later evaluation, on any split, takes it from there. A plain splat beside a refiner has its own best
threshold, found the same way.

Source: paper, implementation details, "Post processing"; Choy et al., "3D-R2N2", ECCV 2016.

The networks whose clouds (or log-volumes) a refiner reads do not change. They run inside its step,
so that augmentation reaches them; on the split that they were trained on they are better than on
images new to them, so a refiner learns from better clouds than it meets later.

**Ours**: 3D-R2N2 predicts in the frame of the first view it is given, in which all is measured
here, instead of the data set's own frame, the same for all views. One view alone faces the task of
the point networks; of further ones it has to find out itself how they are turned.
"""

import dataclasses
import functools
import pathlib
import shutil
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax import linen as nn
from jax.sharding import Mesh

from psgn_jax import evaluate as evaluate_lib
from psgn_jax import registry
from psgn_jax.config import Config, ConfigError, to_dict, to_json
from psgn_jax.data.schema import OCCUPANCY_SIZE
from psgn_jax.losses.iou import PREDICTION_THRESHOLDS, iou_sweep, soft_iou_loss
from psgn_jax.models import r2n2, voxel_refiner
from psgn_jax.models.point_out_net import DTYPES
from psgn_jax.training import state as state_lib
from psgn_jax.training import step as step_lib
from psgn_jax.training.checkpoint import Checkpoints
from psgn_jax.training.log import write_atomic
from psgn_jax.types import Array

GRID = (OCCUPANCY_SIZE,) * 3
THRESHOLD_OF = "threshold_of_"
"""Before the name of a metric: the threshold that was chosen for it."""

CLOUDS = ("from_cd", "from_emd")


def _apply(model: nn.Module, params: Any, *inputs: Any) -> Array:
    return cast(Array, model.apply({"params": params}, *inputs))


class _Voxels:
    """What the three have in common; see `tasks.Task`."""

    title: str
    metric: str = ""
    """The IoU that says which checkpoint is the best."""

    def __init__(self, config: Config, workdir: pathlib.Path) -> None:
        self._config, self._workdir = config, workdir
        depth = ("depth", "extrinsics") if "depth" in config.data.inputs else ()
        self.keys: tuple[str, ...] = ("image", "mask", *depth, "occupancy")
        self._frozen: dict[str, Any] = {}

    # What a task adds.

    def _init(self, key: Array) -> Any:
        raise NotImplementedError

    def _loss(self, params: Any, frozen: Any, batch: step_lib.Batch, drawn: Any) -> Array:
        raise NotImplementedError

    def _measure(
        self, params: Any, frozen: Any, batch: step_lib.Batch, drawn: Any
    ) -> tuple[Array, dict[str, Array]]:
        """Predictions, and metrics [B]; or [B, thresholds], of which one is to be chosen."""
        raise NotImplementedError

    def _draw(self, index: Array | int, batch_size: int) -> Any:
        return None

    # What a run does with it.

    def check(self) -> None:
        """Nothing is left to check."""

    def keep_sources(self) -> None:
        """There are none."""

    def create(self, tx: optax.GradientTransformation) -> state_lib.TrainState:
        """As `Task.create`."""
        params = self._init(state_lib.init_key(self._config))["params"]
        return state_lib.fresh(self._config, params, tx)

    def train_step(
        self, tx: optax.GradientTransformation, mesh: Mesh
    ) -> Callable[
        [state_lib.TrainState, step_lib.Batch], tuple[state_lib.TrainState, dict[str, Array]]
    ]:
        """`training.step.compile_train_step` of the task's loss."""

        def objective(
            params: Any, frozen: Any, batch: step_lib.Batch, drawn: Any, _: Any
        ) -> tuple[Array, dict[str, Array]]:
            value = self._loss(params, frozen, batch, drawn)
            return value, {"loss_step": value}

        def draw(step: Array) -> tuple[Any, None]:
            return self._draw(step, self._config.train.batch_size), None

        return step_lib.compile_train_step(
            self._config, objective, tx, mesh, frozen=self._frozen, draw=draw
        )

    @functools.cached_property
    def _eval_step(self) -> Callable[..., Any]:
        def make(mesh: Mesh) -> Callable[..., Any]:
            return step_lib.compile_eval_step(
                self._measure, mesh, frozen=self._frozen, draw=self._draw
            )

        return evaluate_lib.over_devices(self._config, self.keys, make)

    def evaluate(
        self,
        params: Any,
        *,
        split: str | None = None,
        max_samples: int = 0,
        on_batch: Callable[[int, Any, np.ndarray], None] | None = None,
        chosen: Mapping[str, float] | None = None,
    ) -> evaluate_lib.Evaluation:
        """As `Task.evaluate`; the thresholds are what is chosen."""
        found = evaluate_lib.evaluate(
            self._config,
            params,
            split=split,
            max_samples=max_samples,
            eval_step=self._eval_step,
            on_batch=on_batch,
        )
        return at_thresholds(found, chosen or {}, best=self.metric)

    def picture(self, params: Any) -> None:
        """None is drawn."""


def at_thresholds(
    found: evaluate_lib.Evaluation, chosen: Mapping[str, float], *, best: str = ""
) -> evaluate_lib.Evaluation:
    """An evaluation whose sweeps [samples, thresholds] give way to the values at one of them.

    Args:
      found: what was measured.
      chosen: `{"threshold_of_iou": .4, ...}` from an earlier evaluation; a threshold that is not
        there is chosen here: that of the best mean over the samples.
      best: metric of which `one_minus_iou` is added.
    """
    metrics: dict[str, np.ndarray] = {}
    taken: dict[str, float] = {}
    fresh = []
    for name, values in found.metrics.items():
        if values.ndim == 1:
            metrics[name] = values
            continue
        key = THRESHOLD_OF + name
        if key in chosen:
            column = int(np.argmin(np.abs(np.array(PREDICTION_THRESHOLDS) - chosen[key])))
        else:
            column = int(np.argmax(values.mean(axis=0)))
            fresh.append(name)
        metrics[name] = values[:, column]
        taken[key] = PREDICTION_THRESHOLDS[column]
    if best in metrics:
        metrics["one_minus_iou"] = 1 - metrics[best]
    where = "on this very split" if fresh else "where the run was evaluated while it trained"
    text = ", ".join(f"{k.removeprefix(THRESHOLD_OF)} {v:g}" for k, v in taken.items())
    note = (
        f"IoU of {OCCUPANCY_SIZE}^3 solid volumes; thresholds, chosen {where}: {text}."
        if taken
        else "Natural logarithms of volumes in radius^3."
    )
    return dataclasses.replace(found, metrics=metrics, note=note, chosen=taken)


class Source(NamedTuple):
    """A trained run that another one reads, and does not change."""

    config: Config
    step: int
    params: Any


def load_source(config: Config, workdir: pathlib.Path, name: str) -> Source:
    """The run that `voxels.<name>` names, from the copy below `workdir` once there is one.

    Raises:
      ConfigError: there is no such run, or it sees other images or predicts another thing.
      CheckpointError: it has no checkpoint.
    """
    path, wanted = config.voxels.sources[name], "volume" if name == "from_volume" else "points"
    copy = workdir / "frozen" / name
    kept = (copy / "config.json").exists()
    folder = copy if kept else pathlib.Path(path)
    if not (folder / "config.json").exists():
        raise ConfigError(
            f"voxels.{name}={path!r}: no run there; accepted: the folder of a trained run of the "
            f"task {wanted!r}"
        )
    theirs = evaluate_lib.load_config(folder)
    if theirs.task != wanted:
        raise ConfigError(
            f"voxels.{name}={path!r} is a run of the task {theirs.task!r}; accepted: {wanted!r}"
        )
    for field in ("image_size", "inputs"):
        have, want = getattr(theirs.data, field), getattr(config.data, field)
        if have != want:
            raise ConfigError(f"data.{field}={want!r}: accepted: {have!r}, as in voxels.{name}")
    step, params = evaluate_lib.load_params(folder, "last" if kept else "best")
    return Source(theirs, step, params)


def keep_source(workdir: pathlib.Path, name: str, source: Source) -> None:
    """Copies a run that is read into `workdir/frozen/<name>`, unless that is done."""
    folder = workdir / "frozen" / name
    if (folder / "config.json").exists():
        return
    shutil.rmtree(folder, ignore_errors=True)  # of a copying that was killed
    checkpoints = Checkpoints(folder / "checkpoints")
    checkpoints.save(
        source.step,
        state_lib.named_leaves({"params": source.params}),
        {"config": to_dict(source.config), "seed": source.config.seed},
    )
    checkpoints.close()
    write_atomic(folder / "config.json", to_json(source.config))  # last: it says that all is there


class Refine(_Voxels):
    """Clouds of one or two trained networks to a volume (`models.voxel_refiner.VoxelRefiner`).

    Metrics: `iou`, and of each cloud the plain splat's, `iou_splat_cd`, `iou_splat_emd`.
    """

    metric = "iou"

    def __init__(self, config: Config, workdir: pathlib.Path) -> None:
        super().__init__(config, workdir)
        names = list(config.voxels.sources)
        self._clouds = [name for name in names if name in CLOUDS]
        self._with_volume = "from_volume" in names
        self._sources = {name: load_source(config, workdir, name) for name in names}
        self._frozen = {name: source.params for name, source in self._sources.items()}
        self._networks = {
            name: registry.build_model(self._sources[name].config.model) for name in self._clouds
        }
        if self._with_volume:
            theirs = self._sources["from_volume"].config.model
            self._volume_net = voxel_refiner.build_volume_net(theirs)
        self._model = voxel_refiner.VoxelRefiner(
            len(self._clouds),
            self._with_volume,
            config.voxels.widths,
            DTYPES[config.model.compute_dtype],
        )
        self.title = "refiner of " + ", ".join(name.removeprefix("from_") for name in names)

    def keep_sources(self) -> None:
        """As `Task.keep_sources`."""
        for name, source in self._sources.items():
            keep_source(self._workdir, name, source)

    def _draw(self, index: Array | int, batch_size: int) -> dict[str, Array | None]:
        return {
            name: step_lib.draw_r(self._sources[name].config, index, batch_size, train=False)
            for name in self._clouds
        }

    def _init(self, key: Array) -> Any:
        volumes = jnp.zeros(1) if self._with_volume else None
        return self._model.init(key, jnp.zeros((1, *GRID, len(self._clouds))), volumes)

    def _predict(
        self, params: Any, frozen: Any, batch: step_lib.Batch, drawn: Any
    ) -> tuple[Array, Array]:
        """Probabilities [B,x,y,z], and the splats [B,x,y,z,clouds] that they come from."""
        clouds = [
            step_lib.predict(
                self._sources[name].config, self._networks[name], frozen[name], batch, drawn[name]
            )
            for name in self._clouds
        ]
        splats = jax.vmap(lambda *one: voxel_refiner.splat_clouds(one))(*clouds)
        volumes = None
        if self._with_volume:
            seen = step_lib.images(self._config, batch)
            volumes = _apply(self._volume_net, frozen["from_volume"], seen)
        return _apply(self._model, params, splats, volumes), splats

    def _loss(self, params: Any, frozen: Any, batch: step_lib.Batch, drawn: Any) -> Array:
        pred, _ = self._predict(params, frozen, batch, drawn)
        return jax.vmap(soft_iou_loss)(pred, batch["occupancy"].astype(pred.dtype)).mean()

    def _measure(
        self, params: Any, frozen: Any, batch: step_lib.Batch, drawn: Any
    ) -> tuple[Array, dict[str, Array]]:
        pred, splats = self._predict(params, frozen, batch, drawn)
        metrics = {"iou": jax.vmap(iou_sweep)(pred, batch["occupancy"])}
        for channel, name in enumerate(self._clouds):
            sweep = jax.vmap(iou_sweep)(splats[..., channel], batch["occupancy"])
            metrics["iou_splat_" + name.removeprefix("from_")] = sweep
        return pred, metrics


class Volume(_Voxels):
    """An image to the logarithm of the object's volume (`models.voxel_refiner.VolumeNet`).

    The loss is the squared error of the natural logarithm. Metric: its absolute value.
    """

    def __init__(self, config: Config, workdir: pathlib.Path) -> None:
        super().__init__(config, workdir)
        self._model = voxel_refiner.build_volume_net(config.model)
        self.title = "volume network"

    def _init(self, key: Array) -> Any:
        model = self._config.model
        return self._model.init(key, jnp.zeros((1, *model.image_size, model.in_channels)))

    def _errors(self, params: Any, batch: step_lib.Batch) -> tuple[Array, Array]:
        pred = _apply(self._model, params, step_lib.images(self._config, batch))
        return pred, pred - jax.vmap(voxel_refiner.log_volume)(batch["occupancy"])

    def _loss(self, params: Any, frozen: Any, batch: step_lib.Batch, drawn: Any) -> Array:
        return jnp.square(self._errors(params, batch)[1]).mean()

    def _measure(
        self, params: Any, frozen: Any, batch: step_lib.Batch, drawn: Any
    ) -> tuple[Array, dict[str, Array]]:
        pred, error = self._errors(params, batch)
        return pred[:, None], {"log_volume_abs_error": jnp.abs(error)}


class Views(_Voxels):
    """3D-R2N2 (`models.r2n2`): one or more images to a volume, by cross-entropy.

    Metrics: `iou_1_views`, `iou_3_views`, ... for each of `voxels.eval_views`. The prediction is
    that of the first of these numbers.
    """

    def __init__(self, config: Config, workdir: pathlib.Path) -> None:
        super().__init__(config, workdir)
        voxels = config.voxels
        dtype = DTYPES[config.model.compute_dtype]
        self._model = r2n2.build(voxels.cell, voxels.width_multiplier, dtype)
        self._names = {count: f"iou_{count}_views" for count in voxels.eval_views}
        self.metric = self._names[voxels.eval_views[0]]
        self.title = f"3D-R2N2 ({voxels.cell}, widths times {voxels.width_multiplier:g})"

    def _init(self, key: Array) -> Any:
        model = self._config.model
        return self._model.init(key, jnp.zeros((1, 1, *model.image_size, model.in_channels)))

    def _loss(self, params: Any, frozen: Any, batch: step_lib.Batch, drawn: Any) -> Array:
        logits = _apply(self._model, params, step_lib.images(self._config, batch))
        return jax.vmap(r2n2.voxel_cross_entropy)(logits, batch["occupancy"]).mean()

    def _measure(
        self, params: Any, frozen: Any, batch: step_lib.Batch, drawn: Any
    ) -> tuple[Array, dict[str, Array]]:
        seen, metrics, volumes = step_lib.images(self._config, batch), {}, []
        for count, name in self._names.items():
            logits = _apply(self._model, params, seen[:, :count])
            volumes.append(r2n2.occupancy(logits))
            metrics[name] = jax.vmap(iou_sweep)(volumes[-1], batch["occupancy"])
        return volumes[0], metrics
