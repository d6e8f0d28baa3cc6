"""Cameras in ``automap init``: calibrations that lie there, views that people know, or neither."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from automap.io.drive import load_drive
from pipeline.check.command import check_drive
from pipeline.init.choose import draft_of
from pipeline.init.found import look
from pipeline.init.settle import settle
from tests.slow_cases import others_slow
from tests.unit.foreign_tables import SAMPLE

MATRIX = np.array([[1003.25, 0.0, 641.5], [0.0, 998.75, 355.125], [0.0, 0.0, 1.0]])
DISTORTION = [-0.31, 0.12, 0.001, -0.002, 0.03]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The sample drive's recordings."""
    shutil.copytree(SAMPLE, tmp_path / "d", ignore=shutil.ignore_patterns("drive.toml", "_automap"))
    return tmp_path / "d"


def _calibrate(path: Path, width: int, height: int) -> None:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", width)
    storage.write("image_height", height)
    storage.write("camera_matrix", MATRIX)
    storage.write("distortion_coefficients", np.array(DISTORTION))
    storage.release()


def _said(folder: Path, answers: Sequence[str] = ()) -> tuple[dict[str, Any], str]:
    """The section of the camera in the manifest, and all of it."""
    left = list(answers)

    def ask(question: str, choices: Sequence[str]) -> str:
        return left.pop(0) if "[video.front]" in question else ""

    text = draft_of(look(folder), folder, ask if answers else None).manifest("d")
    (folder / "drive.toml").write_text(text, encoding="utf-8")
    return tomllib.loads(text)["video"]["front"], text


def _size(folder: Path) -> tuple[int, int]:
    section = _said(folder)[0]
    return section["width"], section["height"]


def test_a_calibration_beside_the_video_is_its_cameras(folder: Path) -> None:
    width, height = _size(folder)
    _calibrate(folder / "calibration.yml", width, height)
    section, text = _said(folder)
    np.testing.assert_allclose(section["camera_matrix"], MATRIX)
    assert section["distortion"] == pytest.approx(DISTORTION)
    assert "# of calibration.yml" in text
    assert load_drive(folder).camera_warnings() == []


def test_a_calibration_of_a_larger_picture_is_scaled(folder: Path) -> None:
    """A point at half the way across stays there."""
    width, height = _size(folder)
    _calibrate(folder / "calibration.yml", 2 * width, 2 * height)
    matrix = np.array(_said(folder)[0]["camera_matrix"])
    assert matrix[0, 0] == pytest.approx(MATRIX[0, 0] / 2.0)
    assert matrix[:2, 2] + 0.5 == pytest.approx((MATRIX[:2, 2] + 0.5) / 2.0)


def test_a_calibration_of_another_shape_is_not_used(folder: Path) -> None:
    width, _ = _size(folder)
    _calibrate(folder / "calibration.yml", width, width)
    section, text = _said(folder)
    assert "camera_matrix" not in section
    assert "another shape: it is not used" in " ".join(text.replace("#", "").split())


def test_of_two_calibrations_the_cameras_own_is_taken(folder: Path) -> None:
    width, height = _size(folder)
    _calibrate(folder / "rear.yml", width, height)
    (folder / "front.yml").write_text(
        f"cam0:\n  intrinsics: [800, 801, 640, 360]\n  resolution: [{width}, {height}]\n"
    )
    assert _said(folder)[0]["camera_matrix"][0][0] == 800.0


def test_a_view_that_is_known_makes_a_pinhole(folder: Path) -> None:
    section, _ = _said(folder, ["90"])
    assert section["camera_matrix"][0][0] == pytest.approx(section["width"] / 2.0)
    assert section["camera_matrix"][0][2] == pytest.approx((section["width"] - 1) / 2.0)


@pytest.mark.parametrize("answer", ["", "wide", "5", "200"])
def test_an_unknown_view_is_told_and_the_drive_has_a_camera_all_the_same(
    folder: Path, answer: str
) -> None:
    section, text = _said(folder, [answer])
    assert "camera_matrix" not in section
    assert "a view of 60 degrees along the longer side is taken" in " ".join(
        text.replace("#", "").split()
    )
    drive = load_drive(folder)
    assert list(drive.cameras()) == ["front"]
    assert "film a chessboard" in drive.camera_warnings()[0]


def test_without_a_video_the_size_of_its_pictures_is_asked(folder: Path) -> None:
    video = folder / "video"
    (video / "front.mp4").unlink()
    (video / "front_detections.csv").write_text("frame,class,x_min,y_min,x_max,y_max,score\n")
    section, _ = _said(folder, ["1242 x 375", "81"])
    assert (section["width"], section["height"]) == (1242, 375)
    assert section["camera_matrix"][0][0] == pytest.approx(727.1, abs=0.1)


@pytest.mark.parametrize(
    ("name", "camera", "ahead_h"),
    [
        ("20260314_092000.mp4", "front", 0.0),
        ("2026_0314_202000_001F.MP4", "F", 11.0),
        ("NO20260314-202000-000123R.mp4", "NO-R", 11.0),
        ("VID_20260314_092000123.mp4", "VID", 0.0),
    ],
)
def test_a_dated_name_tells_when_a_video_began(
    folder: Path, name: str, camera: str, ahead_h: float
) -> None:
    """To a second, in the zone in which it is of the drive; dates and numbers name no camera."""
    shutil.rmtree(folder / "video")
    shutil.copy(SAMPLE / "video/front.mp4", folder / name)
    _on_unix_time(folder)
    draft = draft_of(look(folder), folder, None)
    settle(draft)
    section = f"video.{camera}"
    second = 1773480000.0
    assert draft.get(section, "start_ns") * 1e-9 == pytest.approx(second, abs=1.0)
    assert draft.get(section, "time_offset_sigma_s") == 1.0
    assert (f"{ahead_h:+g} h" in draft.why(section, "start_ns")) == bool(ahead_h)


@pytest.mark.parametrize("arrivals", others_slow([True, False]))
def test_a_dated_name_tells_it_beside_readings_whose_count_begins_anywhere(
    folder: Path, arrivals: bool
) -> None:
    """The fixes tell the date of the drive, and arrival times or motions tie the count to it."""
    shutil.rmtree(folder / "video")
    shutil.copy(SAMPLE / "video/front.mp4", folder / "20260314_202000.mp4")
    if not arrivals:
        (folder / "gnss_arrival.csv").unlink()
    draft = draft_of(look(folder), folder, None)
    settle(draft)
    assert draft.get("imu", "time") == "boot_ns"
    assert draft.get("video.front", "time") == "unix_ns"
    assert draft.get("video.front", "start_ns") == 1773480000_500_000_000
    (folder / "drive.toml").write_text(draft.manifest("d"), encoding="utf-8")
    told = [each.text for each in check_drive(folder).findings]
    assert not any("no frame was taken" in text or "start_ns" in text for text in told)


@pytest.mark.parametrize(("hours", "told"), [(0.1, False), (5.0, True)])
def test_a_track_alone_has_the_time_of_a_dated_video(
    tmp_path: Path, hours: float, told: bool
) -> None:
    """As of a phone's GPX beside a dash camera; where it is long, zones are doubted."""
    shutil.copy(SAMPLE / "video/front.mp4", tmp_path / "20260314_092000.mp4")
    start = datetime(2026, 3, 14, 9, 19, tzinfo=UTC)
    points = "".join(
        f'<trkpt lat="{-35.0 + 1e-4 * k:.5f}" lon="149.0"><time>'
        f"{(start + timedelta(hours=hours * k / 300.0)):%Y-%m-%dT%H:%M:%SZ}</time></trkpt>"
        for k in range(301)
    )
    (tmp_path / "a.gpx").write_text(f"<gpx><trk><trkseg>{points}</trkseg></trk></gpx>")
    draft = draft_of(look(tmp_path), tmp_path, None)
    settle(draft)
    assert draft.get("video.front", "start_ns") == 1773480000_500_000_000
    assert draft.get("video.front", "time") == "unix_ns"
    assert any("zones; UTC is taken" in doubt for doubt in draft.doubts) == told


@pytest.mark.slow
def test_a_name_of_another_day_tells_no_beginning(folder: Path) -> None:
    shutil.rmtree(folder / "video")
    shutil.copy(SAMPLE / "video/front.mp4", folder / "20260311_092000.mp4")
    _on_unix_time(folder)
    draft = draft_of(look(folder), folder, None)
    settle(draft)
    assert draft.get("video.front", "start_ns") is None
    assert any("20260311_092000.mp4" in doubt for doubt in draft.doubts)
    (folder / "drive.toml").write_text(draft.manifest("d"), encoding="utf-8")
    told = [each.text for each in check_drive(folder).findings]
    assert any("no frame was taken during the drive" in text for text in told)


def test_frame_times_of_another_name_are_the_only_videos(folder: Path) -> None:
    (folder / "video/front.mp4").rename(folder / "video/cam.mp4")
    (folder / "video/front_frames.csv").rename(folder / "frames.csv")
    draft = draft_of(look(folder), folder, None)
    assert [s for s in draft.sections if s.startswith("video.")] == ["video.cam"]
    assert draft.get("video.cam", "frames").name == "frames.csv"


def _on_unix_time(folder: Path) -> None:
    """The sample's readings by UNIX time, with fixes and without arrival times."""
    (folder / "gnss_arrival.csv").unlink()
    head, *rows = (folder / "imu.csv").read_text().splitlines()
    start = int(rows[0].split(",")[0])
    moved = [
        f"{int(t) - start + 1773480000_000000000},{values}"
        for t, values in (row.split(",", 1) for row in rows)
    ]
    (folder / "imu.csv").write_text("\n".join([head, *moved]) + "\n")
