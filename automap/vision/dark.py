"""Dark and noisy pictures made more like those of the day before they are searched."""

from __future__ import annotations

import cv2
import numpy as np

from automap.gates import sd_by_median
from automap.records import Image
from automap.vision import limits

_STEP = 8
"""Every eighth pixel tells the light."""
_MASK = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)


def brightened(image: Image) -> Image:
    """A BGR picture [height, width, 3] of 8 bits as it is best searched.

    Smoothed and raised if it is dark and noisy, otherwise the same. Only pictures are touched
    whose noise is a good part of their light: dark ones without noise are searched as well as
    bright ones, and a higher gain alone would cost more than it helps. Lamps do not count: the
    light is that which a twentieth of the picture exceeds.
    """
    white = float(np.percentile(image[::_STEP, ::_STEP, 1], limits.WHITE_PERCENTILE))
    if white >= limits.DARK_GREYS or noise_of(image) < limits.NOISY_SHARE * white:
        return image
    gain = float(np.clip(limits.WANTED_GREYS / max(white, 1.0), 1.0, limits.MOST_GAIN))
    smooth = cv2.GaussianBlur(image, (0, 0), limits.SMOOTH_PX)
    return np.asarray(cv2.convertScaleAbs(smooth, alpha=gain), np.uint8)


def noise_of(image: Image) -> float:
    """Standard deviation of the noise in grey levels of the middle of a BGR picture.

    By the median of a mask that plane light and straight edges leave at zero (after Immerkaer
    1996, *Fast noise variance estimation*).
    """
    top = max((image.shape[0] - limits.NOISE_BAND_PX) // 2, 0)
    band = np.ascontiguousarray(image[top : top + limits.NOISE_BAND_PX])
    grey = cv2.cvtColor(band, cv2.COLOR_BGR2GRAY).astype(np.float32)
    rough = np.asarray(cv2.filter2D(grey, -1, _MASK)[1:-1, 1:-1], np.float64)
    # the mask makes six times the noise of a pixel
    return sd_by_median(rough) / 6.0 if rough.size else 0.0
