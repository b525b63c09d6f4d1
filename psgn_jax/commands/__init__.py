"""One module for each subcommand of `psgn`."""
