"""Motion from pictures: rendered far and near points under a known turn."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from automap.frames import matrix_to_rotation_vector, rotation_vector_to_matrix
from automap.vision.camera_motion import ImageMotion, guessed_motion
from automap.vision.search import default_camera

CAMERA = default_camera(640, 360)


def view(turn: np.ndarray, ahead: float, seed: int = 0) -> np.ndarray:
    """Speckles at 10 to 200 m, seen after turning by a rotation vector and going ahead."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(10.0, 200.0, 900)
    place = np.column_stack([np.ones(900), rng.uniform(-1, 1, 900), rng.uniform(-0.6, 0.6, 900)])
    place *= depth[:, None]
    radius = rng.uniform(0.004, 0.012, 900) * depth
    grey = rng.integers(30, 226, 900)
    ray = (place - [ahead, 0, 0]) @ rotation_vector_to_matrix(turn)
    image = np.full((360, 640, 3), 128, np.uint8)
    f, cx, cy = CAMERA.matrix[0, 0], CAMERA.matrix[0, 2], CAMERA.matrix[1, 2]
    for k in np.argsort(-ray[:, 0]):
        if ray[k, 0] < 2:
            continue
        x, y = cx + f * ray[k, 1] / ray[k, 0], cy + f * ray[k, 2] / ray[k, 0]
        size = max(f * radius[k] / ray[k, 0], 1.0)
        level = (int(grey[k]),) * 3
        place_px = (round(x * 16), round(y * 16))
        cv2.circle(image, place_px, round(size * 16), level, -1, cv2.LINE_AA, 4)
    return image


@pytest.mark.parametrize("ahead", [0.0, 1.5])
@pytest.mark.parametrize("turn_deg", [(0, 0, 3.0), (0, 0, -1.5), (0, 1.0, 0.5), (2.0, -0.5, 1.0)])
def test_the_turn_is_found_whatever_the_distances(
    turn_deg: tuple[float, float, float], ahead: float
) -> None:
    turn = np.radians(turn_deg)
    motions = ImageMotion(CAMERA)
    motions.step(view(np.zeros(3), 0.0), 0.1)
    motion = motions.step(view(turn, ahead), 0.1)
    found = matrix_to_rotation_vector(motion.C_new_old.T)
    np.testing.assert_allclose(np.degrees(found), turn_deg, atol=0.25)
    assert np.abs(found - turn).max() < 4 * motion.turn_sd


def test_a_standstill_is_seen() -> None:
    motions = ImageMotion(CAMERA)
    rng = np.random.default_rng(1)
    for _ in range(2):
        noisy = view(np.zeros(3), 0.0).astype(int) + rng.normal(0, 3, (360, 640, 3))
        motion = motions.step(np.clip(noisy, 0, 255).astype(np.uint8), 0.1)
    assert np.linalg.norm(motion.moved) == 0.0


def test_without_anything_to_see_it_is_a_guess() -> None:
    motions = ImageMotion(CAMERA)
    blank = np.full((360, 640, 3), 40, np.uint8)
    for _ in range(2):
        motion = motions.step(blank, 0.1)
    guess = guessed_motion(0.1)
    np.testing.assert_array_equal(motion.moved, guess.moved)
    assert motion.turn_sd == guess.turn_sd
