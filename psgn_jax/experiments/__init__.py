"""The experiments of the paper: one file and one command each."""
