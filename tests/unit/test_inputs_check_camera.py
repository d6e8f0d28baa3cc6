"""Cameras and videos that do not belong together, as `check` tells them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from input_drive import BOOT_NS, write_drive

from pipeline.check.command import check_drive
from tests.unit.checked_drive import edit, errors_told, ingested


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return write_drive(tmp_path / "formula")


@pytest.mark.slow
def test_a_camera_that_does_not_fit_its_video(drive: Path) -> None:
    from test_inputs_video import _make

    (drive / "video").mkdir()
    _make(drive / "video" / "front.mp4", list(range(0, 2000, 40)))
    manifest = drive / "drive.toml"
    manifest.write_text(
        manifest.read_text() + "[video.front]\nstart_ns = 0\nwidth = 192\nheight = 128\n"
        "camera_matrix = [[150.0, 0.0, 96.0], [0.0, 150.0, 64.0], [0.0, 0.0, 1.0]]\n"
    )
    assert "192x128, the video has 96x64" in errors_told(check_drive(drive))
    edit(drive, "192", "96")
    edit(drive, "height = 128", "height = 64")
    errors = errors_told(check_drive(drive))
    assert errors.count("another resolution") == 1
    # of another size than the video alone tells, as well
    edit(drive, "width = 96\nheight = 64\n", "")
    assert errors_told(check_drive(drive)).count("another resolution") == 1
    edit(drive, "schema", 'accept = ["camera_matrix"]\nschema')
    assert check_drive(drive).usable
    edit(drive, "64.0], [0.0, 0.0", "39.0], [0.0, 0.0")
    edit(drive, "96.0], [0.0, 150", "48.0], [0.0, 150")
    assert "11 % off that of 96x64" in check_drive(drive).text().replace("\n", " ").replace(
        "  ", ""
    )
    edit(drive, "[video.front]", "[video.front]\nwidth = 96\nheight = 72")
    assert "its proportions are others" in errors_told(check_drive(drive))


def test_a_wide_view_without_distortion_is_told_by_check_and_run(drive: Path) -> None:
    """As a matrix of half the resolution has it: nine of ten signs lay outside their ellipses."""
    manifest = drive / "drive.toml"
    manifest.write_text(
        manifest.read_text() + "[video.front]\nwidth = 1242\nheight = 375\n"
        "camera_matrix = [[353.5, 0.0, 601.0], [0.0, 353.5, 183.0], [0.0, 0.0, 1.0]]\n"
    )
    told = "and no distortion, which no lens so wide is without"
    assert " ".join(check_drive(drive).text().split()).count(told) == 1
    assert any(told in text for text in ingested(drive, drive / "work").warnings)


def test_frames_of_another_video_are_told(drive: Path) -> None:
    from test_inputs_video import _make

    (drive / "video").mkdir()
    _make(drive / "video" / "front.mp4", list(range(0, 2000, 40)))
    manifest = drive / "drive.toml"
    manifest.write_text(manifest.read_text() + "[video.front]\nwidth = 96\nheight = 64\n")
    rows = [f"{k},{BOOT_NS + k * 40_000_000}" for k in range(60)]
    for n, told in ((60, True), (50, False)):
        text = "\n".join(["frame,t_ns", *rows[:n]])
        (drive / "video" / "front_frames.csv").write_text(text + "\n")
        assert (f"lists {n} frames, the video has 50" in check_drive(drive).text()) == told


@pytest.mark.slow
def test_chapters_that_were_filmed_in_another_order_are_told(drive: Path) -> None:
    import av

    for minute in (1, 2):
        with av.open(str(drive / f"{minute}.mp4"), "w") as container:
            container.metadata["creation_time"] = f"2026-03-14T09:2{minute}:00Z"
            stream = container.add_stream("mpeg4", rate=10, width=96, height=64, pix_fmt="yuv420p")
            picture = av.VideoFrame.from_ndarray(np.zeros((64, 96, 3), np.uint8), format="bgr24")
            container.mux(stream.encode(picture))
            container.mux(stream.encode())
    before = (drive / "drive.toml").read_text()
    for files, told in (('["2.mp4", "1.mp4"]', True), ('["1.mp4", "2.mp4"]', False)):
        text = f"{before}[video.front]\nfiles = {files}\nstart_ns = 0\n"
        (drive / "drive.toml").write_text(text)
        assert ("filmed 60 s before the file ahead of it" in check_drive(drive).text()) == told


def test_a_focal_length_in_millimetres_stops_a_run(drive: Path) -> None:
    """No sign can be placed by a view of 179 deg: nothing to go on with, whatever is accepted."""
    manifest = drive / "drive.toml"
    before = manifest.read_text()
    manifest.write_text(
        'accept = ["camera_view"]\n'
        + before
        + '[video.front]\ndetections = "d.csv"\nframes = "f.csv"\nwidth = 1242\nheight = 375\n'
        "camera_matrix = [[4.2, 0.0, 610.0], [0.0, 4.2, 173.0], [0.0, 0.0, 1.0]]\n"
    )
    (drive / "d.csv").write_text("frame,class,x_min,y_min,x_max,y_max,score\n")
    (drive / "f.csv").write_text("frame,t_ns\n0,0\n1,100000000\n")
    report = check_drive(drive)
    assert "in pixels, not in millimetres" in errors_told(report)
    assert not report.usable


@pytest.mark.parametrize(("apart_s", "far"), [(0.1, False), (1.0, True)])
def test_boxes_without_tracks_far_apart_tell_no_sign_on_a_vehicle(
    apart_s: float, far: bool, drive: Path
) -> None:
    with (drive / "drive.toml").open("a") as manifest:
        manifest.write(
            '[video.front]\ndetections = "d.csv"\nframes = "f.csv"\nwidth = 96\nheight = 64\n'
        )
    (drive / "f.csv").write_text(f"frame,t_ns\n0,{BOOT_NS}\n1,{BOOT_NS + round(apart_s * 1e9)}\n")
    head = "frame,class,x_min,y_min,x_max,y_max,score"
    for column, cell, told in (("", "", far), (",track", ",-1", far), (",track", ",4", False)):
        rows = "".join(f"{frame},a,1,1,9,9,0.9{cell}\n" for frame in (0, 1))
        (drive / "d.csv").write_text(f"{head}{column}\n{rows}")
        assert ("no column track" in check_drive(drive).text()) == told


def test_frames_that_the_header_does_not_give_are_counted(
    drive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import av

    from pipeline.check import camera

    with av.open(str(drive / "front.mkv"), "w", options={"live": "1"}) as container:
        stream = container.add_stream("mpeg4", rate=10, width=96, height=64, pix_fmt="yuv420p")
        for _ in range(30):
            picture = av.VideoFrame.from_ndarray(np.zeros((64, 96, 3), np.uint8), format="bgr24")
            container.mux(stream.encode(picture))
        container.mux(stream.encode())
    with (drive / "drive.toml").open("a") as manifest:
        manifest.write('[video.front]\nfiles = ["front.mkv"]\nstart_ns = 0\n')
    assert "mpeg4 96x64, 30 frames, 3.0 s" in check_drive(drive).text()
    monkeypatch.setattr(camera, "_COUNTED_BYTES", 100)
    text = check_drive(drive).text()
    assert "frames not counted in the file, length not in the file" in text
    assert "nan" not in text
