"""Exports trained networks for other programs as ONNX and StableHLO files."""
