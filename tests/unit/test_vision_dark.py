"""Dark and noisy pictures are smoothed and raised; all others are left alone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from automap.vision.dark import brightened, noise_of

Image = npt.NDArray[np.uint8]


def street(light: float, noise: float) -> Image:
    """A sky, a road and a few houses in some light."""
    rng = np.random.default_rng(1)
    picture = np.full((400, 640, 3), 120.0)
    picture[:180] = 220.0
    for x in range(40, 600, 90):
        picture[120:230, x : x + 50] = rng.uniform(40, 240, 3)
    values = picture * light + rng.normal(0.0, noise, picture.shape)
    return np.clip(values, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("noise", [2.0, 6.0])
def test_noise_is_told_from_edges(noise: float) -> None:
    # grey is a weighted mean of three channels with noise of their own
    weights = np.sqrt(0.114**2 + 0.587**2 + 0.299**2)
    assert noise_of(street(0.6, noise)) == pytest.approx(noise * weights, rel=0.15)
    assert noise_of(street(0.6, 0.0)) == 0.0


@pytest.mark.parametrize(("light", "noise"), [(1.0, 0.0), (1.0, 8.0), (0.3, 0.0), (0.3, 1.0)])
def test_bright_pictures_and_dark_ones_without_noise_stay(light: float, noise: float) -> None:
    picture = street(light, noise)
    assert brightened(picture) is picture


def test_dark_and_noisy_pictures_are_smoothed_and_raised() -> None:
    picture, quiet = street(0.3, 8.0), street(0.3, 0.0)
    better = brightened(picture)
    gain = better.mean() / picture.mean()
    assert 2.0 < gain < 4.0
    assert noise_of(better) / gain < 0.5 * noise_of(picture)
    away = np.abs(better / gain - quiet)
    assert np.median(away) < 0.6 * np.median(np.abs(picture.astype(float) - quiet))


def test_pictures_of_a_few_pixels_and_black_ones_do_no_harm() -> None:
    for shape in ((1, 1, 3), (2, 9, 3), (40, 2, 3)):
        assert brightened(np.zeros(shape, np.uint8)).shape == shape
