"""What light, weather, optics and compression do to a picture.

Every function takes and gives BGR of 8 bits and knows no randomness but the generator it is
given, so the same ones spoil the training pictures at random and the test pictures by a
fixed amount.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Random = np.random.Generator


def _clipped(values: npt.NDArray[np.float32]) -> Image:
    return np.clip(values, 0, 255).astype(np.uint8)


def night(image: Image, rng: Random, gain: float = 0.25, noise: float = 8.0) -> Image:
    """Darkened, with a headlight's pool of light, sensor noise and less colour."""
    height, width = image.shape[:2]
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    pool = np.exp(-(((x / width - 0.5) / 0.5) ** 2) - ((y / height - 0.62) / 0.35) ** 2)
    light = (gain * (0.75 + 0.6 * pool))[:, :, None]
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)[:, :, None].astype(np.float32)
    values = (0.8 * image + 0.2 * grey) * light
    return _clipped(values + grain(rng, image.shape, noise))


def grain(rng: Random, shape: tuple[int, ...], sd: float) -> npt.NDArray[np.float32]:
    """Noise of a sensor after demosaicing: part of it common to the channels and smooth."""
    height, width = shape[:2]
    common = rng.standard_normal((height, width, 1), np.float32)
    each = rng.standard_normal((height, width, 3), np.float32)
    return np.asarray(sd * (0.7 * common + 0.7 * each), np.float32)


def fog(image: Image, thickness: float = 0.55, light: float = 200.0) -> Image:
    """Scattered light, thicker towards the horizon."""
    height = image.shape[0]
    y = np.linspace(0.0, 1.0, height, dtype=np.float32)[:, None, None]
    veil = thickness * (1.0 - 0.4 * np.clip((y - 0.5) * 2.0, 0.0, 1.0))
    return _clipped(image * (1.0 - veil) + light * veil)


def rain(image: Image, rng: Random, streaks: float = 900.0, length: int = 16) -> Image:
    """Bright streaks, ``streaks`` a megapixel, under a grey sky."""
    height, width = image.shape[:2]
    count = int(streaks * height * width / 1e6)
    layer = np.zeros((height, width), np.uint8)
    lean = rng.uniform(-0.35, 0.35)
    for x, y in zip(rng.integers(0, width, count), rng.integers(0, height, count), strict=True):
        long = int(length * rng.uniform(0.5, 1.5))
        end = (int(x + lean * long), int(y + long))
        cv2.line(layer, (int(x), int(y)), end, int(rng.integers(90, 200)), 1, cv2.LINE_AA)
    soft = cv2.GaussianBlur(layer, (3, 3), 0.6)
    values = 0.85 * image.astype(np.float32) + 15.0
    return _clipped(values + 0.8 * soft[:, :, None])


def motion_kernel(length: float, angle_deg: float) -> npt.NDArray[np.float32]:
    """Weights of a line of ``length`` px, of odd size: what each pixel's light is spread over."""
    n = int(np.ceil(length)) | 1
    kernel = np.zeros((n, n), np.float32)
    middle = (n - 1) / 2
    a = np.radians(angle_deg)
    reach = (length - 1) / 2 * np.array([np.cos(a), np.sin(a)])
    start, end = np.round(((middle - reach), (middle + reach))).astype(int).tolist()
    cv2.line(kernel, (start[0], start[1]), (end[0], end[1]), 1.0)
    return np.asarray(kernel / kernel.sum(), np.float32)


def motion_blur(image: Image, length: float = 8.0, angle_deg: float = 0.0) -> Image:
    """Smeared along a line of ``length`` px."""
    return np.asarray(cv2.filter2D(image, -1, motion_kernel(length, angle_deg)), np.uint8)


def compress(image: Image, quality: int = 20) -> Image:
    """Through JPEG."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


def white_balance(image: Image, blue: float = 0.75, red: float = 1.25) -> Image:
    """Other gains of the blue and red channel."""
    gains = np.array([blue, 1.0, red], np.float32)
    return _clipped(image.astype(np.float32) * gains)


def resampled(image: Image, factor: float) -> Image:
    """Taken with fewer pixels and enlarged again."""
    height, width = image.shape[:2]
    size = (max(2, round(width * factor)), max(2, round(height * factor)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR), np.uint8)


def tone(image: Image, gain: float, gamma: float, contrast: float) -> Image:
    """Another exposure and tone curve."""
    levels = np.linspace(0.0, 1.0, 256, dtype=np.float32) ** gamma * gain
    levels = (levels - 0.5) * contrast + 0.5
    table = np.clip(levels * 255.0, 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(image, table), np.uint8)


def at_random(image: Image, rng: Random, strength: float = 1.0) -> Image:
    """A picture as another camera in other weather might have taken it."""
    if rng.random() < 0.55:
        image = tone(image, rng.uniform(0.7, 1.25), rng.uniform(0.7, 1.5), rng.uniform(0.75, 1.25))
    if rng.random() < 0.4:
        image = white_balance(image, rng.uniform(0.7, 1.3), rng.uniform(0.75, 1.3))
    if rng.random() < 0.12:
        image = desaturated(image, rng.uniform(0.3, 1.0))
    if rng.random() < 0.10 * strength:
        image = fog(image, rng.uniform(0.2, 0.65), rng.uniform(140, 235))
    if rng.random() < 0.08 * strength:
        image = rain(image, rng, rng.uniform(300, 1800), int(rng.integers(8, 24)))
    if rng.random() < 0.14 * strength:
        image = motion_blur(image, rng.uniform(2.0, 10.0), rng.normal(0.0, 35.0))
    elif rng.random() < 0.25:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), rng.uniform(0.4, 1.6)), np.uint8)
    if rng.random() < 0.15 * strength:
        image = resampled(image, rng.uniform(0.4, 0.9))
    if rng.random() < 0.20 * strength:
        image = night(image, rng, rng.uniform(0.18, 0.55), rng.uniform(2.0, 10.0))
    elif rng.random() < 0.25:
        image = _clipped(image + grain(rng, image.shape, rng.uniform(1.0, 9.0)))
    if rng.random() < 0.45:
        # poor ones more often: they are what spoils small signs
        image = compress(image, int(12 + 70 * rng.random() ** 1.7))
    return image


def exposed(image: Image, rng: Random) -> Image:
    """Sometimes far too dark, as at dusk, against the light, or far too bright."""
    chance = rng.random()
    if chance < 0.14:
        gain = float(np.exp(rng.uniform(np.log(0.07), np.log(0.6))))
        # what the eighth bit leaves is the sensor's noise
        dark = image * np.float32(gain) + grain(rng, image.shape, rng.uniform(0.0, 2.0))
        return _clipped(dark + 0.5)
    if chance < 0.21:
        return against_light(image, rng)
    if chance < 0.27:
        return _clipped(image.astype(np.float32) * rng.uniform(1.3, 2.2))
    return image


def against_light(image: Image, rng: Random) -> Image:
    """Dark, behind the light that scatters in lens and windscreen, stronger on one side."""
    height, width = image.shape[:2]
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    a = rng.uniform(0.0, 2.0 * np.pi)
    ramp = np.cos(a) * (x / width - 0.5) + np.sin(a) * (y / height - 0.5)
    veil = rng.uniform(8.0, 90.0) * (1.0 + rng.uniform(0.0, 0.8) * ramp)
    colour = rng.uniform([0.75, 0.85, 0.9], [1.1, 1.05, 1.15]).astype(np.float32)
    values = image * np.float32(rng.uniform(0.12, 0.6)) + veil[:, :, None] * colour
    return _clipped(values + grain(rng, image.shape, rng.uniform(0.0, 2.5)) + 0.5)


def desaturated(image: Image, by: float) -> Image:
    """With colour taken out, 0 none to 1 all."""
    grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
    return np.asarray(cv2.addWeighted(image, 1.0 - by, grey, by, 0.0), np.uint8)
