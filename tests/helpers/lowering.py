"""Lowers a function for CUDA on a machine without CUDA."""

import re

import jax
import jax.numpy as jnp
import pytest

_TYPES = {"f": jnp.float32, "i": jnp.int32}


def kernels(function, *arguments, **options):
    """Names of the Triton kernels in the lowered module; arguments are (shape, "f" or "i")."""
    if jax.__version_info__ > (0, 10, 1):
        # Later versions of jax compile Triton kernels while they lower them. Only the CUDA plugin
        # contains that compiler.
        try:
            if not any(d.platform == "gpu" for d in jax.devices("gpu")):
                pytest.skip("this jax lowers Triton kernels only with a GPU")
        except RuntimeError:
            pytest.skip("this jax lowers Triton kernels only with a GPU")
    arguments = [jax.ShapeDtypeStruct(shape, _TYPES[kind]) for shape, kind in arguments]
    lowered = jax.jit(function).trace(*arguments).lower(lowering_platforms=("cuda",), **options)
    text = lowered.as_text()
    assert text.count("triton") >= 1 or "custom_call" not in text
    return re.findall(r'gpu\$xla\.gpu\.triton.*?\bname = "(\w+)"', text)
