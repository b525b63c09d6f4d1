"""How a camera turns light into a picture."""

import dataclasses

import numpy as np
import scipy.ndimage
from jaxtyping import Float, UInt8

from data_gen.field_checks import Range, check_ranges

# Brighter than this times white is cut off before the lens blurs.
_BRIGHTEST = 6.0


@dataclasses.dataclass(frozen=True)
class FilmSettings:
    """How a camera turns light into a picture, for "photo" shading; ranges are drawn from.

    Attributes:
      exposure: in stops, from that of an automatic camera.
      white_balance: how much of the light's colour is taken out, 0 to 1.
      contrast: of the tone curve, 0 = none, 1 = that of films.
      saturation: factor on the distance of colours from grey.
      vignette: how much darker the corners are, 0 to 1.
      blur: of the lens: deviation in pixels.
      grain: of the sensor: deviation at middle grey, 1 = white.
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
    """The picture that a camera makes of light.

    Args:
      light: linear.
      weight: what the exposure is measured on.
      settings: of the film.
      rng: of the draw.
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
    # What is bright may be white, but not large parts of the picture.
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
        # The sensor counts light: noise grows with its root, a little is always there.
        spread = draw["grain"] * np.sqrt(0.05 + values / 0.2).astype(np.float32) * 0.4
        values = values + spread * rng.standard_normal(values.shape, np.float32)
        values = np.maximum(values, 0)
    # Plain values with a soft shoulder, and a film's curve (Narkowicz 2015).
    plain = np.where(values < 0.6, values, 1 - 0.4 * np.exp(-(values - 0.6) / 0.4))
    x = values * np.float32(0.75)
    film = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)
    mixed = plain + draw["contrast"] * (film - plain)
    grey = mixed.mean(axis=-1, keepdims=True)
    mixed = grey + np.float32(draw["saturation"]) * (mixed - grey)
    return np.rint(255 * np.clip(mixed, 0, 1) ** (1 / 2.2)).astype(np.uint8)
