"""The task "refiner": maps the clouds of trained networks to a solid volume.

Source: paper, implementation details, "Post processing". For comparison, we also measure the IoU of
each cloud's splat without the refiner, at a threshold chosen for it.

The networks that predict the clouds (and the log-volume) are frozen. They run inside the refiner's
training step, so that augmentations apply to their inputs. The refiner sees better clouds in
training than at test time, because the networks were trained on the same images.
"""

import pathlib
import shutil
from typing import Any

import jax
import jax.numpy as jnp

from psgn_jax.array_types import Array
from psgn_jax.config.experiment import Config, ConfigError, to_dict, to_json
from psgn_jax.losses.iou import iou_sweep, soft_iou_loss
from psgn_jax.models import networks, volumes
from psgn_jax.system.files import write_atomic
from psgn_jax.tasks.task import Batch, Result
from psgn_jax.tasks.voxels import VoxelTask, apply
from psgn_jax.weights.checkpoint import Checkpoints
from psgn_jax.weights.leaves import named_leaves
from psgn_jax.weights.run_folder import Trained, open_run

CLOUDS = ("from_cd", "from_emd")


def open_source(config: Config, workdir: pathlib.Path, name: str) -> Trained:
    """Opens the run in `voxels.<name>`, or its copy in `workdir` if there is one.

    `ConfigError` if there is no run, or if its image size, inputs or task do not match.
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
    run = open_run(folder, "last" if kept else "best", name=f"voxels.{name}")
    if run.config.task != wanted:
        raise ConfigError(
            f"voxels.{name}={path!r} is a run of the task {run.config.task!r}; accepted: {wanted!r}"
        )
    for field in ("image_size", "inputs"):
        have, want = getattr(run.config.data, field), getattr(config.data, field)
        if have != want:
            raise ConfigError(f"data.{field}={want!r}: accepted: {have!r}, as in voxels.{name}")
    return run


class Refiner(VoxelTask):
    """Maps clouds of one or two trained networks to a volume (`models.volumes.VoxelRefiner`).

    Metrics: `iou` of the refiner; `iou_splat_cd`, `iou_splat_emd` of the clouds' splats.
    """

    best = "iou"

    def __init__(self, config: Config, workdir: pathlib.Path) -> None:
        dtype = networks.DTYPES[config.model.compute_dtype]
        super().__init__(config, volumes.VoxelRefiner(config.voxels.widths, dtype))
        names = list(config.voxels.sources)
        self.title = "refiner of " + ", ".join(name.removeprefix("from_") for name in names)
        self.workdir = workdir
        self.sources = {name: open_source(config, workdir, name) for name in names}
        self.frozen = {name: source.params for name, source in self.sources.items()}
        configs = {name: self.sources[name].config for name in names if name in CLOUDS}
        # Name -> configuration and network that predicts clouds.
        self.clouds = {name: (c, networks.build(c.model)) for name, c in configs.items()}
        self.volume_net = None
        if "from_volume" in names:
            of_volume = self.sources["from_volume"].config.model
            self.volume_net = networks.build_volume_net(of_volume)

    def init_params(self) -> Any:
        grids = jnp.zeros((1, *volumes.GRID, len(self.clouds)))
        size = None if self.volume_net is None else jnp.zeros(1)
        return self.model.init(networks.init_key(self.config), grids, size)["params"]

    def latents(self, step: Array | int, batch_size: int, *, train: bool) -> dict[str, Array]:
        """Random inputs of the networks that predict clouds, drawn as in an evaluation."""
        found: dict[str, Array] = {}
        for name, (source, _) in self.clouds.items():
            r = networks.random_input(source, step, batch_size, train=False)
            found |= {} if r is None else {f"r_{name}": r}
        return found

    def predict(self, frozen: Any, params: Any, batch: Batch) -> tuple[Array, Array]:
        """Probabilities [B,x,y,z], and splats of the clouds [B,x,y,z,clouds]."""
        predicted = [
            networks.predict(source, network, frozen[name], batch, batch.get(f"r_{name}"))
            for name, (source, network) in self.clouds.items()
        ]
        splats = jnp.stack([jax.vmap(volumes.splat)(cloud) for cloud in predicted], axis=-1)
        sizes = None
        if self.volume_net is not None:
            sizes = apply(self.volume_net, frozen["from_volume"], self.seen(batch))
        return apply(self.model, params, splats, sizes), splats

    def total_loss(self, frozen: Any, params: Any, batch: Batch, step: Array) -> Result:
        pred, _ = self.predict(frozen, params, batch)
        value = jax.vmap(soft_iou_loss)(pred, batch["occupancy"].astype(pred.dtype)).mean()
        return value, {"loss": value}

    def measure(self, frozen: Any, params: Any, batch: Batch) -> Result:
        pred, splats = self.predict(frozen, params, batch)
        metrics = {"iou": jax.vmap(iou_sweep)(pred, batch["occupancy"])}
        for channel, name in enumerate(self.clouds):
            sweep = jax.vmap(iou_sweep)(splats[..., channel], batch["occupancy"])
            metrics["iou_splat_" + name.removeprefix("from_")] = sweep
        return pred, metrics

    def keep_sources(self) -> None:
        """Copies runs into the folder `frozen`, unless complete copies exist."""
        for name, source in self.sources.items():
            folder = self.workdir / "frozen" / name
            if (folder / "config.json").exists():
                continue
            shutil.rmtree(folder, ignore_errors=True)  # a copy that was interrupted by a kill
            checkpoints = Checkpoints(folder / "checkpoints")
            meta = {"config": to_dict(source.config), "seed": source.config.seed}
            checkpoints.save(source.step, named_leaves({"params": source.params}), meta)
            checkpoints.close()
            # Written last, because it marks a complete copy.
            write_atomic(folder / "config.json", to_json(source.config))
