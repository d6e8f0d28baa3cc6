"""Calibrations of cameras in other programs' formats."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from automap.io.camera_file import read_camera_file

MATRIX = np.array([[1003.25, 0.0, 641.5], [0.0, 998.75, 355.125], [0.0, 0.0, 1.0]])
DISTORTION = [-0.31, 0.12, 0.001, -0.002, 0.03]


def _opencv(path: Path) -> None:
    """As cv2.calibrateCamera's users write it."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Mon 1 Jan 2024 10:00:00")
    storage.write("nframes", 25)
    storage.write("image_width", 1280)
    storage.write("image_height", 720)
    storage.write("camera_matrix", MATRIX)
    storage.write("distortion_coefficients", np.array(DISTORTION).reshape(-1, 1))
    storage.write("avg_reprojection_error", 0.4)
    storage.release()


def _row(values: object) -> str:
    return ", ".join(f"{v:.6g}" for v in np.ravel(np.asarray(values)))


ROS = f"""image_width: 1280
image_height: 720
camera_name: front
camera_matrix:
  rows: 3
  cols: 3
  data: [{_row(MATRIX)}]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [{_row(DISTORTION)}]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [900, 0, 640, 0, 0, 900, 360, 0, 0, 0, 1, 0]
"""
KALIBR = f"""cam0:
  cam_overlaps: []
  camera_model: pinhole
  distortion_coeffs: [{_row(DISTORTION[:4])}]
  distortion_model: {{model}}
  intrinsics: [1003.25, 998.75, 641.5, 355.125]
  resolution: [1280, 720]
  rostopic: /cam0/image_raw
"""
KITTI = f"""calib_time: 09-Jan-2012 13:57:47
S_02: 1.392000e+03 5.120000e+02
K_02: 9.6e+02 0 7.0e+02 0 9.6e+02 2.2e+02 0 0 1
S_rect_02: 1.280000e+03 7.200000e+02
P_rect_02: {" ".join(f"{v:.6e}" for v in np.column_stack([MATRIX, [4.5, 0.0, 0.0]]).ravel())}
"""
JSON = f'{{{{"mtx": {MATRIX.tolist()}, "dist": [{DISTORTION}]}}}}'.replace("{{", "{").replace(
    "}}", "}"
)


@pytest.mark.parametrize("suffix", [".yaml", ".xml", ".json"])
def test_what_opencv_writes(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"camera{suffix}"
    _opencv(path)
    found = read_camera_file(path)
    assert found is not None
    np.testing.assert_allclose(found.matrix, MATRIX)
    assert found.distortion == pytest.approx(DISTORTION)
    assert found.size == (1280, 720)


@pytest.mark.parametrize(
    ("text", "distortion", "size"),
    [
        (ROS, DISTORTION, (1280, 720)),
        (KALIBR.format(model="radtan"), DISTORTION[:4], (1280, 720)),
        (KITTI, [], (1280, 720)),
        (JSON, DISTORTION, None),
    ],
    ids=["ros", "kalibr", "kitti", "json"],
)
def test_what_others_write(
    text: str, distortion: list[float], size: tuple[int, int] | None, tmp_path: Path
) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(text)
    found = read_camera_file(path)
    assert found is not None
    np.testing.assert_allclose(found.matrix, MATRIX)
    assert list(found.distortion) == pytest.approx(distortion)
    assert found.size == size
    assert found.doubt is None


def test_the_distortion_of_a_fish_eye_is_left_out_and_told(tmp_path: Path) -> None:
    path = tmp_path / "camchain.yaml"
    path.write_text(KALIBR.format(model="equidistant"))
    found = read_camera_file(path)
    assert found is not None
    assert found.distortion == ()
    assert found.doubt is not None
    assert "equidistant" in found.doubt


@pytest.mark.parametrize(
    "text",
    ["", "a: 1\n", "camera_matrix: [1, 2, 3]\n", "K: [0, 0, 1, 0, 5, 1, 0, 0, 1]\n", "P2: 1 2 3\n"],
)
def test_what_is_no_calibration(text: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    assert read_camera_file(path) is None


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=st.text(alphabet='camer_tix: [](){}<>/"0123456789.,-\n', max_size=200))
def test_any_text_is_looked_at(tmp_path: Path, text: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text("camera_matrix: " + text)
    read_camera_file(path)
