"""The task "points": predicts a cloud from an image, with the paper's networks and losses."""

import pathlib
from collections.abc import Sequence
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax.array_types import Array
from psgn_jax.config.experiment import Config, ConfigError
from psgn_jax.evaluation import clouds as metrics_lib
from psgn_jax.evaluation.aligned import aligned_metrics
from psgn_jax.evaluation.results import Evaluation
from psgn_jax.evaluation.split import eval_batches
from psgn_jax.losses.by_name import LossTerm, chosen_points, parse_terms, sum_of
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.losses.mapping import map_pairs
from psgn_jax.losses.min_of_n import MinOfN, min_of_n
from psgn_jax.models import networks, posterior
from psgn_jax.prediction.draws import sample_latents, summarise_draws, total_mutual_difference
from psgn_jax.prediction.refine import first_clouds
from psgn_jax.tasks.task import Batch, Metrics, Result, Task
from psgn_jax.viewing import spheres

# Weights w of the L2 terms w * sum(kernel**2) / 2 in the authors' training code, and of the sum.
L2_CONV, L2_DENSE, L2_CARRY = 1e-5, 1e-3, 1e-4
L2_SCALE = 0.1
_NUM_PICTURES = 6  # at most, in TensorBoard


class Points(Task):
    """Trains a network of `models.networks.NETWORKS`; metrics: `evaluation.clouds`.

    Metrics of a training step, scalars except `kl_of_dims`:

    - `loss`: without the L2 and KL terms.
    - `loss_<name>`, if the loss is a sum: each term of `loss`, without its weight.
    - `loss_of_draws`, if `loss.min_of_n` > 1: the distance that chooses the best draw (the loss, or
      with `loss.winner_points` a Chamfer distance of so many points), averaged over all draws.
      `loss` is averaged over the best draws.
    - `l2`, unless `loss.l2` is "none": the L2 term.
    - With `model.posterior`: `kl`, the divergence in nats, summed over the dimensions of z and
      averaged over the samples; `kl_of_dims`, the same for each dimension; `active_dims`, the
      number of dimensions above `posterior.ACTIVE`; `kl_weight`, the weight of `kl`.
    """

    def __init__(
        self, config: Config, workdir: pathlib.Path = pathlib.Path(), draws: int = 0
    ) -> None:
        super().__init__(config, networks.input_keys(config))
        self.draws = draws  # further predictions per image that `measure` compares
        self.title, self.model = config.model.name, networks.build(config.model)
        terms = parse_terms(config.loss)
        _check_loss(config, terms, self.model.num_points)
        self.loss = sum_of(terms)

    def init_params(self) -> Any:
        return networks.init_params(self.config, self.model)

    def latents(self, step: Array | int, batch_size: int, *, train: bool) -> dict[str, Array]:
        config, r = self.config, networks.random_input(self.config, step, batch_size, train=train)
        found = {} if r is None else {"r": r}
        if self.draws:
            place = step * batch_size, batch_size, self.draws
            seed = np.uint32(config.seed & 0xFFFFFFFF)
            found["draws"] = sample_latents(config, *place, seed)
        return found

    def predict(self, params: Any, batch: Batch, r: Array | None) -> Array:
        return networks.predict(self.config, self.model, params, batch, r)

    def total_loss(self, frozen: Any, params: Any, batch: Batch, step: Array) -> Result:
        loss, r, metrics = self.config.loss, batch.get("r"), Metrics()
        extra = jnp.float32(0)
        if self.config.model.posterior and r is not None:
            volumes = jax.vmap(posterior.occupied)(batch["points"])
            encoder = networks.build_posterior(self.config.model)
            q = cast(posterior.Gaussian, encoder.apply({"params": params[posterior.NAME]}, volumes))
            r = posterior.reparameterise(q, r)
            metrics["kl_of_dims"] = jnp.mean(posterior.kl_of_dims(q), axis=0)
            metrics["kl"] = jnp.sum(metrics["kl_of_dims"])
            active = metrics["kl_of_dims"] > posterior.ACTIVE
            metrics["active_dims"] = jnp.sum(active, dtype=jnp.float32)
            warmup = loss.kl_warmup_steps  # the weight rises linearly from 0, then is constant
            share = jnp.minimum(jnp.float32(1), step / warmup) if warmup else jnp.float32(1)
            metrics["kl_weight"] = jnp.asarray(loss.kl_weight * share, jnp.float32)
            extra += metrics["kl_weight"] * metrics["kl"]
        if loss.min_of_n > 1 and r is not None:
            value, best = self.min_of_n_loss(params, batch, r)
            metrics["loss_of_draws"] = jnp.mean(best.distances)
            terms = best.aux
        else:
            pred = self.predict(params, batch, r)
            values, terms = map_pairs(self.loss)(pred, batch["points"])
            value = jnp.mean(values)
        metrics |= {f"loss_{name}": jnp.mean(values) for name, values in terms.items()}
        metrics["loss"] = value
        if loss.l2 != "none":
            metrics["l2"] = L2_SCALE * l2_authors(params)
            extra += metrics["l2"]
        return value + extra, metrics

    def min_of_n_loss(self, params: Any, batch: Batch, r: Array) -> tuple[Array, MinOfN]:
        """Mean over the batch of the loss of each sample's best draw, for r [B,draws,size].

        The best draw has the smallest of `MinOfN.distances`: of the losses or, with
        `loss.winner_points` = k > 0, of the Chamfer distances of k points to k true points. In the
        first case, value and gradient are those of `min_of_n` of all draws, up to rounding. In the
        second, `loss.mean_weight` adds the Chamfer distance of the first draw, an estimate of the
        mean over all draws.

        Only the best draw of each sample has a gradient. So we compute all draws without storing
        activations, and the best draws again for the backward pass; parts without r only once.
        """
        constant, rows, gt = jax.lax.stop_gradient(params), jnp.arange(len(r)), batch["points"]
        preds, k = self.predict(constant, batch, r), self.config.loss.winner_points
        if k:

            def by_few(pred: Array, gt: Array) -> Array:
                return chamfer_sq_mean(chosen_points(pred, k), chosen_points(gt, k))

            best = jax.lax.stop_gradient(map_pairs(min_of_n(by_few))(preds, gt))
            weight = self.config.loss.mean_weight
            chosen = [best.winner, jnp.zeros_like(best.winner)] if weight else [best.winner]
            preds = self.predict(params, batch, r[rows[:, None], jnp.stack(chosen, axis=1)])
            values, aux = map_pairs(self.loss)(preds[:, 0], gt)
            total = jnp.mean(values)
            if weight:
                total += weight * jnp.mean(map_pairs(chamfer_sq_mean)(preds[:, 1], gt))
            return total, best._replace(value=values, aux=aux)

        def smallest(preds: Array) -> tuple[Array, MinOfN]:
            best = map_pairs(min_of_n(self.loss, has_aux=True))(preds, gt)
            return jnp.sum(best.value), best

        # The second pass uses the loss's derivative with respect to the points.
        (value, best), by_points = jax.value_and_grad(smallest, has_aux=True)(preds)
        pred = self.predict(params, batch, r[rows, best.winner])
        # Its value is zero, its gradient the loss's, by the chain rule through the points.
        carried = by_points[rows, best.winner] * (pred - jax.lax.stop_gradient(pred))
        best = jax.lax.stop_gradient(best)
        return (jax.lax.stop_gradient(value) + jnp.sum(carried)) / len(r), best

    def measure(self, frozen: Any, params: Any, batch: Batch) -> Result:
        settings = self.config.eval
        if settings.refine:
            placed = self.config.data.eval_frame == "place"
            _, pred = first_clouds(self.config, self.model, params, batch, placed=placed)
        else:
            pred = self.predict(params, batch, batch.get("r"))

        def measure_pair(pred: Any, gt: Any, visible: Any = None) -> Metrics:
            # The EMD needs at least as many true points as predicted points.
            tolerance = (settings.emd_tolerance if len(pred) <= len(gt) else 0) or None
            metrics = metrics_lib.evaluate_pair(
                pred, gt, visible, threshold=settings.fscore_threshold, emd_tolerance=tolerance
            )
            if settings.aligned:
                emd = metrics.get("emd_radius")
                metrics |= aligned_metrics(pred, gt, emd_tolerance=tolerance, known_emd=emd)
            return metrics

        visible = [batch["visible"]] if "visible" in batch else []
        metrics = map_pairs(measure_pair)(pred, batch["points"], *visible)
        return pred, metrics | (self._of_draws(params, batch) if "draws" in batch else {})

    def _of_draws(self, params: Any, batch: Batch) -> Metrics:
        """Best-of-K and mean-of-K of CD and, if it is measured, EMD; how much the draws differ."""
        drawn, gt = self.predict(params, batch, batch["draws"]), batch["points"]
        distances: dict[str, Any] = {"cd_sq_radius2": chamfer_sq_mean}
        if (tolerance := self.config.eval.emd_tolerance) and drawn.shape[2] <= gt.shape[1]:
            distances["emd_radius"] = lambda a, b: metrics_lib.emd(a, b, tolerance=tolerance).emd
        metrics = map_pairs(lambda a, b: summarise_draws(a, b, distances))(drawn, gt)
        if self.draws > 1:
            difference = jax.lax.map(total_mutual_difference, drawn)
            metrics["total_mutual_difference_radius2"] = difference
        return metrics

    def evaluate(
        self, params: Any, *, chosen: Any = None, draws: int = 0, **options: Any
    ) -> Evaluation:
        if not draws:
            return super().evaluate(params, **options)
        if not self.config.model.random_size:
            raise ConfigError(
                f"draws={draws}: model.random_size=0, so this network gives one prediction per "
                "image; accepted: a network trained with a random input, such as configs/mo2_cd.py"
            )
        return Points(self.config, draws=draws).evaluate(params, **options)

    def picture(self, params: Any) -> np.ndarray:
        """A picture of the first evaluation samples: predictions beside true clouds."""
        config = self.config
        (batch,) = eval_batches(config, choose=lambda number: range(1))
        points, _ = self.eval_step(params, batch, 0)
        rows = []
        for i in np.flatnonzero(batch["valid"])[:_NUM_PICTURES].tolist():
            case = {key: batch[key][i] for key in ("image", "intrinsics", "extrinsics")}
            pred = np.asarray(points[i])
            clouds = {"prediction": pred, "truth": spheres.thinned(batch["points"][i], pred)}
            drawn = spheres.panels(case, spheres.by_height(clouds), (0, 90))
            rows.append(np.concatenate(list(drawn.values()), axis=1))
        return np.concatenate(rows)


def l2_authors(params: Any) -> Array:
    """The authors' L2 terms: half the weighted sum of squares of each kernel, without biases."""
    total = jnp.float32(0)
    for path, leaf in jax.tree_util.tree_flatten_with_path(params)[0]:
        names = [str(getattr(entry, "key", entry)) for entry in path]
        if names[-1] != "kernel":
            continue
        dense = L2_CARRY if any("carry" in name for name in names) else L2_DENSE
        total += (L2_CONV if leaf.ndim >= 4 else dense) * 0.5 * jnp.sum(jnp.square(leaf))
    return total


def _check_loss(config: Config, terms: Sequence[LossTerm], num_points: int) -> None:
    """Raises `ConfigError` if the loss does not fit the numbers of points."""
    if config.loss.winner_points > (most := min(num_points, config.data.num_points)):
        raise ConfigError(
            f"loss.winner_points={config.loss.winner_points}: accepted: at most {most}, the points "
            "of the smaller cloud (the network's, or data.num_points)"
        )
    sizes = num_points, config.data.num_points
    pred, gt = (jax.ShapeDtypeStruct((n, 3), np.float32) for n in sizes)
    for term in terms:
        try:
            jax.eval_shape(term.distance, pred, gt)
        except ValueError as error:
            which = f", the term {term.text!r}," if len(terms) > 1 else ""
            what = f"data.num_points={sizes[1]} and a network of {num_points} points"
            raise ConfigError(
                f"loss.name={config.loss.name!r}{which} with {what}: {error}"
            ) from error
