"""Dark and noisy pictures made more like those of the day before they are searched."""

from __future__ import annotations

import cv2
import numpy as np

from automap.records import Image

_STEP = 8
_WHITE_SHARE = 95.0
_DARK = 140.0
_WANTED, _MOST_GAIN = 180.0, 4.0
_NOISY = 0.04
_SMOOTH_PX = 0.9
_BAND = 192
_MASK = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)


def brightened(image: Image) -> Image:
    """A BGR picture [height, width, 3] of 8 bits as it is best searched.

    Smoothed and raised if it is dark and noisy, otherwise the same. Only pictures are touched
    whose noise is a good part of their light: dark ones without noise are searched as well as
    bright ones, and a higher gain alone would cost more than it helps. Lamps do not count: the
    light is that which a twentieth of the picture exceeds.
    """
    white = float(np.percentile(image[::_STEP, ::_STEP, 1], _WHITE_SHARE))
    if white >= _DARK or noise_of(image) < _NOISY * white:
        return image
    gain = float(np.clip(_WANTED / max(white, 1.0), 1.0, _MOST_GAIN))
    smooth = cv2.GaussianBlur(image, (0, 0), _SMOOTH_PX)
    return np.asarray(cv2.convertScaleAbs(smooth, alpha=gain), np.uint8)


def noise_of(image: Image) -> float:
    """Standard deviation of the noise in grey levels of the middle of a BGR picture.

    By the median of a mask that plane light and straight edges leave at zero (after Immerkaer
    1996, *Fast noise variance estimation*).
    """
    top = max((image.shape[0] - _BAND) // 2, 0)
    band = np.ascontiguousarray(image[top : top + _BAND])
    grey = cv2.cvtColor(band, cv2.COLOR_BGR2GRAY).astype(np.float32)
    rough = np.abs(cv2.filter2D(grey, -1, _MASK)[1:-1, 1:-1])
    return float(np.median(rough)) / 0.6745 / 6.0 if rough.size else 0.0
