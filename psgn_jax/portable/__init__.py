"""Exports trained networks for other programs: ONNX, StableHLO, and a folder with both."""
