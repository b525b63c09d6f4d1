"""The experiments of the paper; `runner` has their common parts."""
