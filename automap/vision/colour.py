"""How red, blue or yellow each pixel is, whatever the light."""

from __future__ import annotations

import cv2
import numpy as np

from automap.vision.detector import Image

COLOURS = ("red", "blue", "yellow")

# levels at which a map is cut: a sign in haze is found at a low one, a sign before a
# background of its own colour parts from it at a high one
LEVELS = {"red": (16, 26, 46, 75, 110), "blue": (32, 60, 95, 130), "yellow": (40, 70, 105)}

_FLOOR = 20


def colour_maps(image: Image) -> dict[str, Image]:
    """Maps [h, w] of 0..255 for red, blue and yellow in a BGR picture.

    A map is the lead of the colour's channel (yellow: of its two channels) over the others,
    relative to the sum of all three, so that it does not depend on the exposure; where the
    picture is too dark to tell, the sum is held up and the map falls to 0. After the
    enhancement of Ruta, Li, Liu, Pattern Recognition 43 (2010) 416-430, eq. 1.
    """
    blue, green, red = cv2.split(image)
    # the mean of the three channels: a third of the sum, in 8 bits
    mean = cv2.addWeighted(cv2.addWeighted(blue, 0.5, red, 0.5, 0.0), 2 / 3, green, 1 / 3, 0.0)
    mean = cv2.max(mean, np.full_like(mean, _FLOOR))
    leads = {
        "red": cv2.subtract(red, cv2.max(green, blue)),
        # cyan and sky have green near blue, a blue face has not
        "blue": cv2.subtract(blue, cv2.addWeighted(red, 0.5, green, 0.5, 0.0)),
        # leaves and grass are greener than red, a yellow face is not
        "yellow": cv2.subtract(cv2.subtract(cv2.min(red, green), blue), cv2.subtract(green, red)),
    }
    # lead / sum * 255 = lead * 85 / mean
    return {
        name: np.asarray(cv2.divide(lead, mean, scale=85.0), np.uint8)
        for name, lead in leads.items()
    }
