"""The response of a camera: from linear radiance to an image."""

import dataclasses

import numpy as np
import scipy.ndimage
from jaxtyping import Float, UInt8

from data_gen.field_checks import Range, check_ranges

# Values above this multiple of white are clipped before the lens blur is applied.
_BRIGHTEST = 6.0


@dataclasses.dataclass(frozen=True)
class FilmSettings:
    """The response of a camera, for "photo" shading. Values are drawn uniformly from the ranges.

    Attributes:
      exposure: deviation from automatic exposure, in stops.
      white_balance: fraction of the light's colour that is removed, 0 to 1.
      contrast: contrast of the tone curve, 0 = none, 1 = that of film.
      saturation: factor of the distance of colours from grey.
      vignette: relative darkening of the corners, 0 to 1.
      blur: blur of the lens: standard deviation in pixels.
      grain: noise of the sensor: standard deviation at middle grey, 1 = white.
    """

    exposure: Range = (-0.6, 0.5)
    white_balance: Range = (0.6, 1.0)
    contrast: Range = (0.7, 1.0)
    saturation: Range = (0.9, 1.25)
    vignette: Range = (0.0, 0.25)
    blur: Range = (0.3, 0.6)
    grain: Range = (0.0, 0.02)

    def __post_init__(self) -> None:
        """Checks the ranges."""
        limits: dict[str, Range] = {
            "exposure": (-10.0, 10.0),
            "white_balance": (0.0, 1.0),
            "contrast": (0.0, 1.0),
            "saturation": (0.0, 4.0),
            "vignette": (0.0, 1.0),
            "blur": (0.0, 10.0),
            "grain": (0.0, 1.0),
        }
        check_ranges("film", self, limits)


def develop(
    light: Float[np.ndarray, "h w 3"],
    weight: Float[np.ndarray, "h w"],
    settings: FilmSettings,
    rng: np.random.Generator,
    *,
    illuminant: Float[np.ndarray, " 3"],
) -> UInt8[np.ndarray, "h w 3"]:
    """The image that a camera records.

    Args:
      light: linear radiance.
      weight: weights of the pixels in the measurement of the exposure.
      settings: the response of the camera.
      rng: the random generator.
      illuminant: colour of the light.
    """
    height, width = weight.shape
    draw = {
        f.name: float(rng.uniform(*getattr(settings, f.name))) for f in dataclasses.fields(settings)
    }
    shift = 1 + 0.02 * rng.standard_normal(3)
    balance = (illuminant.mean() / np.maximum(illuminant, 1e-6)) ** draw["white_balance"] * shift
    values = light * balance.astype(np.float32)
    grey = values.mean(axis=-1)
    middle = np.exp((np.log(grey + 1e-4 * grey.max() + 1e-9) * weight).sum() / weight.sum())
    gain = 0.2 * 2 ** draw["exposure"] / middle
    # Bright parts may be white, but not a large fraction of the image.
    bright = max(float(np.quantile(grey, 0.93)), 1e-9)
    gain = min(gain, 0.75 * 2 ** max(draw["exposure"], 0) / bright)
    values = values * np.float32(gain)
    values = np.clip(values, 0, _BRIGHTEST)
    if draw["vignette"] > 0:
        rows, columns = np.mgrid[:height, :width]
        away = np.hypot(rows / height - 0.5, columns / width - 0.5)[..., None]
        values = values * (1 - draw["vignette"] * 2 * away**2).astype(np.float32)
    if draw["blur"] > 0:
        values = scipy.ndimage.gaussian_filter(values, (draw["blur"], draw["blur"], 0))
    if draw["grain"] > 0:
        # Shot noise grows with the square root of the light; read noise is constant.
        spread = draw["grain"] * np.sqrt(0.05 + values / 0.2).astype(np.float32) * 0.4
        values = values + spread * rng.standard_normal(values.shape, np.float32)
        values = np.maximum(values, 0)
    # A linear curve with a soft shoulder, and a film curve (Narkowicz 2015).
    plain = np.where(values < 0.6, values, 1 - 0.4 * np.exp(-(values - 0.6) / 0.4))
    x = values * np.float32(0.75)
    film = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)
    mixed = plain + draw["contrast"] * (film - plain)
    grey = mixed.mean(axis=-1, keepdims=True)
    mixed = grey + np.float32(draw["saturation"]) * (mixed - grey)
    return np.rint(255 * np.clip(mixed, 0, 1) ** (1 / 2.2)).astype(np.uint8)
