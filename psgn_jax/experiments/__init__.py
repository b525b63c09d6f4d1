"""The experiments of the paper; each has a file and a command."""

import psgn_jax.command_line  # noqa: F401  # it has to be imported before JAX
