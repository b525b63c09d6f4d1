"""Networks that find the object in a photo: U2-Netp, which the package contains, and rembg's.

U2-Netp (Qin et al., "U2-Net: Going Deeper with Nested U-Structure for Salient Object Detection",
2020) was trained on DUTS-TR. `weights/u2netp.txt` states its source and licence.
"""

import functools
import pathlib
from typing import Any

import numpy as np
from PIL import Image

from psgn_jax.config.experiment import ConfigError
from psgn_jax.system import onnx_runtime
from psgn_jax.system.cores import num_cores
from psgn_jax.system.untrusted import brief

FILE = pathlib.Path(__file__).resolve().parents[1] / "weights" / "u2netp.onnx"
SOURCE: dict[str, Any] = {
    "source": "U2-Netp, trained on DUTS-TR (10,553 pictures of ImageNet)",
    "licences": {
        "Apache-2.0": {
            "holders": ["Xuebin Qin, Zichen Zhang, Chenyang Huang, Masood Dehghan, Osmar R. Zaiane "
                        "and Martin Jagersand"],
        },
    },
}  # fmt: skip
"""A row of sources, as in files of weights."""

SIDE = 320
"""Height and width of the image that U2-Netp sees, whatever its proportions."""
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Of the channels of ImageNet's images in [0, 1], by which U2-Netp's input is normalised."""


def probabilities(
    image: np.ndarray, box: tuple[float, float, float, float], *, both_ways: bool = False
) -> np.ndarray:
    """U2-Netp's probabilities of the object, float32 [SIDE, SIDE], in a box of an image.

    The image is resized and normalised as rembg does.

    Args:
      image: uint8 [h, w, 3] RGB.
      box: left, top, right, bottom in pixels.
      both_ways: whether to average with those of the mirror image.
    """
    small = Image.fromarray(image).resize((SIDE, SIDE), Image.Resampling.LANCZOS, box)
    x = np.asarray(small, np.float32)
    x = (x / max(x.max(), 1) - np.array(MEAN, np.float32)) / np.array(DEVIATION, np.float32)
    p = _u2netp()({"input.1": x.transpose(2, 0, 1)[None]})[0, 0]
    if both_ways:
        mirrored = _u2netp()({"input.1": x[:, ::-1].transpose(2, 0, 1)[None]})[0, 0]
        p = (p + mirrored[:, ::-1]) / 2
    return p


@functools.cache
def _u2netp() -> Any:
    return onnx_runtime.session(FILE, threads=min(4, num_cores()))


def by_rembg(image: np.ndarray, model: str) -> np.ndarray:
    """The mask that a model of rembg (`rembg_session`) finds, float32 [h, w] in [0, 1]."""
    import rembg

    levels = rembg.remove(image, session=rembg_session(model), only_mask=True)
    return np.asarray(levels, np.float32) / 255


@functools.cache
def rembg_session(model: str) -> Any:
    """A model of rembg, which downloads it when it is used for the first time.

    Raises:
      ConfigError: rembg is not installed, does not know the model, or cannot load it.
    """
    name = f"mask_from=rembg:{model}"
    try:
        import rembg
        from rembg.sessions import sessions_names
    except (ImportError, SystemExit) as error:  # it exits without one of its extras
        raise ConfigError(
            f"{name}: rembg cannot be imported ({brief(error)}); pip install 'rembg[cpu]'"
        ) from None

    if model not in sessions_names:
        raise ConfigError(f"{name}: accepted by the installed rembg: {', '.join(sessions_names)}")
    try:
        return rembg.new_session(model, providers=["CPUExecutionProvider"])
    except Exception as error:  # of the download or of the runtime
        raise ConfigError(
            f"{name}: rembg could not load the model ({brief(error)}); run `rembg d {model}` on a "
            f"machine with network access, and copy {model}.onnx into ~/.u2net (U2NET_HOME)"
        ) from None
