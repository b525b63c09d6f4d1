"""Point set generation networks in JAX: from one image of an object to a cloud of 3D points."""

__version__ = "0.1.0.dev0"
