import jax
import numpy as np
import pytest

from psgn_jax.config.experiment import ModelConfig
from psgn_jax.models import networks, posterior


def test_volume_marks_the_cells_of_the_points_and_the_cells_nearest_to_points_outside():
    points = np.array(
        [[-1, -1, 0], [0.999, 0.999, 1.999], [0.01, -0.01, 0.0626], [0.01, -0.01, 0.0626],
         [-1.3, 0.01, -1e-3], [1.0, 1.2, 2.0]], np.float32
    )  # fmt: skip
    volume = np.asarray(jax.jit(posterior.occupied)(points))
    assert volume.shape == (32, 32, 32)
    cells = {tuple(map(int, cell)) for cell in np.argwhere(volume)}
    assert cells == {(0, 0, 0), (31, 31, 31), (16, 15, 1), (0, 16, 0)}
    assert volume.sum() == 4


@pytest.mark.parametrize(("mean", "log_variance"), [(0.0, 0.0), (1.5, -1.0)])
def test_divergence_is_the_integral(mean, log_variance):
    q = posterior.Gaussian(np.full((1, 1), mean, "f4"), np.full((1, 1), log_variance, "f4"))
    z = np.linspace(-30, 30, 200_001)
    log_q = -0.5 * ((z - mean) ** 2 / np.exp(log_variance) + log_variance + np.log(2 * np.pi))
    log_p = -0.5 * (z**2 + np.log(2 * np.pi))
    integral = np.trapezoid(np.exp(log_q) * (log_q - log_p), z)
    np.testing.assert_allclose(posterior.kl_of_dims(q)[0, 0], integral, rtol=1e-5, atol=1e-7)


def test_a_draw_and_the_start_near_the_prior(rng):
    q = posterior.Gaussian(np.float32([[2, -1]]), np.log(np.float32([[0.25, 4]])))
    for noise, want in ((0, [[2, -1]]), (1, [[2.5, 1]])):
        drawn = posterior.reparameterise(q, np.full((1, 2), noise, np.float32))
        np.testing.assert_allclose(drawn, want, rtol=1e-6)
    config = ModelConfig(random_size=5, posterior=True, posterior_widths=(4, 6), posterior_hidden=8)
    net = networks.build_posterior(config)
    volumes = (rng.random((3, 32, 32, 32)) < 0.01).astype(np.float32)
    q, variables = jax.jit(net.init_with_output)(jax.random.key(0), volumes)
    kernels = {name: layer["kernel"].shape for name, layer in variables["params"].items()}
    assert kernels["conv0"] == (5, 5, 5, 1, 4)
    assert (kernels["conv1"], kernels["hidden"]) == ((3, 3, 3, 4, 6), (8**3 * 6, 8))
    assert q.mean.shape == q.log_variance.shape == (3, 5)
    assert float(posterior.kl_of_dims(q).max()) < 0.1
    assert np.abs(q.mean[0] - q.mean[1]).max() > 0
