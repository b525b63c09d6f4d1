"""Trained networks for programs other than this one: ONNX, StableHLO, and a folder with both."""
