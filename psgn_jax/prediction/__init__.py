"""Prediction of point clouds from images, and their files."""
