"""The experiments of the paper; each one is a module and a command."""

import psgn_jax.command_line  # noqa: F401  # must be imported before JAX
