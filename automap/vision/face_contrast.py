"""How far the light and the dark of a sign's face lie apart in a frame.

Michelson's contrast of luminance, (L1 - L0) / (L1 + L0) (A. A. Michelson, Studies in Optics, 1927):
light and exposure, which multiply both, cancel; haze, glare and a dirty windscreen, which add to
both, do not. Grey levels are taken for those of sRGB (IEC 61966-2-1); a camera's own curve differs.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from automap.records import FloatArray, Image

NEAREST_NOISE = 3.0
"""Grey levels that noise and compression leave of a dash camera's picture, one sigma: chosen."""
DARKEST = 0.1
"""Part by which such noise may change the luminance of the light part before it is too dark."""
SMALLEST_PX = 32
"""Of a face's shorter side. Strokes of letters and digits are a seventh of their height (the fonts
of DIN 1451 and of highway signs), which is about half of the face's: two pixels of them then, and
what is finer a lens and a video's compression level out."""
SATURATED = 250
"""Grey level from which a channel may be at its end."""
OF_BOX = 0.45
"""Half axes of the ellipse that is looked at, as a part of half the box: it lies within faces of
every shape, the triangle being the narrowest."""
_LOW, _HIGH = 10.0, 90.0
"""Percentiles that stand for the dark and the light."""


def _luminance_of_grey() -> FloatArray:
    level = np.arange(256) / 255.0
    return np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)


_LINEAR = _luminance_of_grey()
_WEIGHT = np.array([0.0722, 0.7152, 0.2126])
"""Of blue, green and red in the luminance (ITU-R BT.709)."""


def face_contrast(image: Image, box: FloatArray) -> tuple[float, str]:
    """Contrast, 0 to 1, of the middle of a box [4] in a BGR frame, and "" or why it cannot be told
    (then NaN): "too small", "too dark" or "too bright"."""
    part = _middle(image, box)
    if part is None:
        return float("nan"), "too small"
    if np.mean(part.max(axis=1) >= SATURATED) > 0.01 * (100.0 - _HIGH):
        return float("nan"), "too bright"
    dark, light = np.percentile(_LINEAR[part] @ _WEIGHT, (_LOW, _HIGH))
    level = float(np.searchsorted(_LINEAR, light))
    # luminance goes with the grey level's power of about 2.2
    if DARKEST * level < 2.2 * NEAREST_NOISE:
        return float("nan"), "too dark"
    return float((light - dark) / (light + dark)), ""


def _middle(image: Image, box: FloatArray) -> Any:
    """The pixels [n, 3] within the ellipse, pixel centres being integers; None where the box is too
    small, or its middle not in the frame."""
    size = box[2:] - box[:2]
    if not min(size) >= SMALLEST_PX:
        return None
    centre, half = 0.5 * (box[:2] + box[2:]), 0.5 * OF_BOX * size
    low, high = np.ceil(centre - half).astype(np.int64), np.floor(centre + half).astype(np.int64)
    if min(low) < 0 or high[0] >= image.shape[1] or high[1] >= image.shape[0]:
        return None
    part = image[low[1] : high[1] + 1, low[0] : high[0] + 1]
    x = (np.arange(low[0], high[0] + 1) - centre[0]) / half[0]
    y = (np.arange(low[1], high[1] + 1) - centre[1]) / half[1]
    return part[np.hypot(y[:, None], x[None, :]) <= 1.0]
