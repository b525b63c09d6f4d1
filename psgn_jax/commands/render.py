"""`psgn render` is `python data_gen/render.py`."""

from data_gen.render import main

__all__ = ["main"]
