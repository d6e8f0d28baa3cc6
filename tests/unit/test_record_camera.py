"""Cameras without a camera: generated pictures, files, pipes."""

from __future__ import annotations

import os
import shutil
import threading
import time
from pathlib import Path

import av
import numpy as np
import pytest

from automap.errors import ConfigError, InputError
from automap.io.drive import load_drive
from automap.io.frame_times import frame_times
from automap.io.video import video_chapters
from automap.io.video_decode import iter_frames
from pipeline.record.camera import Camera
from pipeline.record.clock import HostClock
from pipeline.record.recorder import Plan, Recorder
from pipeline.record.video_source import parse_camera
from tests.unit.recorded_drive import wait_until

TEST_PICTURE = "lavfi:testsrc=size=160x120:rate=20"


def write_video(path: Path, codec: str, frames: int = 30, form: str | None = None) -> None:
    """A clip whose pictures get brighter."""
    with av.open(str(path), "w", format=form) as out:
        stream = out.add_stream(codec, rate=20)
        stream.width, stream.height = 160, 120
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        for number in range(frames):
            picture = np.full((120, 160, 3), 40 + 5 * number, np.uint8)
            for packet in stream.encode(av.VideoFrame.from_ndarray(picture, "bgr24")):
                out.mux(packet)
        for packet in stream.encode(None):
            out.mux(packet)


def record(folder: Path, source: str, frames: int) -> Recorder:
    recorder = Recorder(folder, Plan(cameras=(parse_camera(f"front={source}"),)), HostClock())
    recorder.start()
    assert wait_until(lambda: recorder.snapshot().cameras["front"].frames >= frames, 30.0)
    return recorder


def test_pictures_and_stamps_belong_together(tmp_path: Path) -> None:
    out = tmp_path / "out"
    begin = time.monotonic_ns()
    ending = record(out, TEST_PICTURE, 12).stop()
    video = load_drive(out).videos["front"]
    assert (video.section.width, video.section.height) == (160, 120)
    chapters, warnings = video_chapters(video)
    times = frame_times(video, chapters)
    assert not warnings
    assert not times.warnings
    assert len(times) == len(chapters[0].pts_ns) == ending.frames["front"]
    assert begin < times.t_ns[0] < times.t_ns[-1] < time.monotonic_ns()
    # the container's own times are those of the table, to its millisecond; pictures that
    # came within one millisecond (a busy computer) lie at its next ones
    ticks = np.rint((times.t_ns - times.t_ns[0]) * 1e-6).astype(int)
    order = np.arange(len(ticks))
    ticks = np.maximum.accumulate(ticks - order) + order
    kept = chapters[0].pts_ns - chapters[0].pts_ns[0]
    assert np.max(np.abs(kept - ticks * 1_000_000)) <= 1_000_000
    assert len(list(iter_frames(video))) == len(times)


def test_what_is_on_the_disk_can_be_played_at_any_time(tmp_path: Path) -> None:
    """As after kill -9: the files are copied while they grow."""
    out = tmp_path / "out"
    recorder = record(out, TEST_PICTURE, 25)
    shutil.copytree(out, tmp_path / "killed")
    recorder.stop()
    video = load_drive(tmp_path / "killed").videos["front"]
    frames = list(iter_frames(video))
    assert len(frames) >= 12
    assert frames[0].image.shape == (120, 160, 3)


@pytest.mark.parametrize("codec", ["mjpeg", "libx264"])
def test_a_file_is_played_at_its_own_pace(tmp_path: Path, codec: str) -> None:
    clip = tmp_path / ("clip.mkv" if codec == "mjpeg" else "clip.mp4")
    write_video(clip, codec)
    recorder = record(tmp_path / "out", str(clip), 30)
    ending = recorder.stop()
    assert ending.frames["front"] == 30
    frames = list(iter_frames(load_drive(tmp_path / "out").videos["front"]))
    stamps = np.array([frame.t_ns for frame in frames])
    assert np.median(np.diff(stamps)) == pytest.approx(50e6, rel=0.2)
    brightness = [float(frame.image.mean()) for frame in frames]
    np.testing.assert_allclose(brightness, 40 + 5 * np.arange(30), atol=6)


def test_a_camera_that_comes_back_gets_a_new_chapter(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.mkv"
    os.mkfifo(pipe)
    clip = tmp_path / "clip.mkv"
    write_video(clip, "mjpeg", 8)

    def send() -> None:
        for _ in range(2):
            with pipe.open("wb") as out:
                out.write(clip.read_bytes())
            time.sleep(0.5)

    sender = threading.Thread(target=send, daemon=True)
    sender.start()
    recorder = record(tmp_path / "out", str(pipe), 16)
    recorder.stop()
    assert any("is lost" in text for text in recorder.warnings)
    video = load_drive(tmp_path / "out").videos["front"]
    assert [path.name for path in video.chapters] == ["front.mkv", "front_2.mkv"]
    frames = list(iter_frames(video))
    assert [frame.frame for frame in frames] == list(range(16))
    brightness = [float(frame.image.mean()) for frame in frames]
    np.testing.assert_allclose(brightness, list(40 + 5 * np.arange(8)) * 2, atol=6)


def test_a_camera_that_sends_nothing_is_told(tmp_path: Path) -> None:
    clock = HostClock()
    camera = Camera(*parse_camera(f"front={TEST_PICTURE}"), clock, lambda level, text: None)
    camera.connect()
    begun = clock()
    assert camera.conditions(begun + 1_000_000_000, begun) == {}
    found = camera.conditions(begun + 3_000_000_000, begun)
    assert found == {"camera-front-silent": "camera front: no frames come"}


@pytest.mark.parametrize("text", ["front", "front=", "=/dev/video0", "1=/dev/video0", "a b=x"])
def test_a_camera_is_a_name_and_a_source(text: str) -> None:
    with pytest.raises(ConfigError, match="NAME=SOURCE"):
        parse_camera(text)


def test_a_file_that_is_no_video(tmp_path: Path) -> None:
    (tmp_path / "text.mp4").write_text("no video")
    plan = Plan(cameras=(parse_camera(f"front={tmp_path / 'text.mp4'}"),))
    with pytest.raises(InputError, match="cannot be opened"):
        Recorder(tmp_path / "out", plan, HostClock()).start()
    assert not (tmp_path / "out").exists()
