"""Pallas kernels of the losses for CUDA GPUs."""
