"""The subcommands of `psgn`, one module each."""
