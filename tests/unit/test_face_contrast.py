"""Contrast of a face: what light and exposure leave, and what cannot be told."""

from __future__ import annotations

import numpy as np
import pytest

from automap.vision.face_contrast import face_contrast

BOX = np.array([10.0, 20.0, 69.0, 79.0])


def striped(dark: float, light: float, exposure: float = 1.0, haze: float = 0.0) -> np.ndarray:
    """A frame of stripes of two luminances, as a camera with sRGB's curve takes it."""
    scene = np.where(np.arange(100) % 12 < 6, dark, light)[None, :] * np.ones((100, 1))
    linear = np.clip(exposure * (scene + haze), 0.0, 1.0)
    grey = np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    )
    return np.repeat(np.rint(255 * grey)[:, :, None], 3, axis=2).astype(np.uint8)


def test_contrast_is_the_ratio_of_luminances_whatever_the_exposure() -> None:
    for exposure in (0.5, 1.0, 1.6):
        value, note = face_contrast(striped(0.1, 0.5, exposure), BOX)
        assert note == ""
        assert value == pytest.approx(0.4 / 0.6, abs=0.02)


def test_a_faded_face_and_haze_have_less() -> None:
    plain, _ = face_contrast(striped(0.1, 0.5), BOX)
    assert face_contrast(striped(0.3, 0.5), BOX)[0] < 0.5 * plain
    assert face_contrast(striped(0.1, 0.5, haze=0.1), BOX)[0] < 0.8 * plain
    assert face_contrast(striped(0.4, 0.4), BOX)[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("image", "box", "note"),
    [
        (striped(0.1, 0.5), BOX - [0.0, 0.0, 30.0, 0.0], "too small"),
        (striped(0.1, 0.5), BOX + 60.0, "too small"),
        (striped(0.1, 0.5), BOX * np.nan, "too small"),
        (striped(0.001, 0.005), BOX, "too dark"),
        (striped(0.1, 0.5, exposure=3.0), BOX, "too bright"),
    ],
)
def test_what_cannot_be_measured_is_said(image: np.ndarray, box: np.ndarray, note: str) -> None:
    value, why = face_contrast(image, box)
    assert np.isnan(value)
    assert why == note
