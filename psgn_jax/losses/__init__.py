"""Distances between point clouds: pure functions on one pair; callers vmap."""
