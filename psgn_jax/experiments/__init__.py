"""The experiments of the paper; each has a file and a command."""
