"""Exports trained networks for other programs as ONNX files."""
