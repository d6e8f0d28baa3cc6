"""Video: exact presentation times, chapters, damage."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from automap.errors import InputError
from automap.io.frame_times import frame_times
from automap.io.manifest import VideoSection
from automap.io.video import VideoInput, image_size, read_chapter, read_header
from automap.io.video_decode import iter_frames

# an uneven cadence: frame number over rate would be wrong by up to 80 ms
_MILLISECONDS = [0, 33, 67, 150, 183, 217, 300, 333, 340, 400, 433, 500]


def _make(path: Path, milliseconds: list[int], size: tuple[int, int] = (96, 64)) -> Path:
    """A video of greys, frame i at level 20 (i mod 12), with B frames as cameras write them."""
    import av

    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=30)
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        stream.codec_context.max_b_frames = 2
        for i, stamp in enumerate(milliseconds):
            image = np.full((size[1], size[0], 3), 20 * (i % 12), np.uint8)
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            frame.pts, frame.time_base = stamp, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _make(tmp_path_factory.mktemp("video") / "front.mp4", _MILLISECONDS)


def _video(*chapters: Path, start_ns: int | None = 1000, frames: Path | None = None) -> VideoInput:
    return VideoInput("front", VideoSection(start_ns=start_ns), chapters, frames)


def test_stamps_are_the_containers_own(clip: Path) -> None:
    times = frame_times(_video(clip))
    np.testing.assert_array_equal(times.t_ns - 1000, np.array(_MILLISECONDS) * 1_000_000)
    assert times.warnings == ()
    assert image_size([clip]) == (96, 64)
    header = read_header(clip)
    assert (header.width, header.frames, header.first_frame) == (96, 12, True)


def test_each_picture_comes_with_its_own_stamp(clip: Path) -> None:
    warnings: list[str] = []
    for frame in iter_frames(_video(clip), warn=warnings.append):
        assert abs(float(frame.image.mean()) - 20 * frame.frame) < 6
        assert frame.t_ns - 1000 == _MILLISECONDS[frame.frame] * 1_000_000
    assert warnings == []


def test_selected_frames_alone_are_decoded(clip: Path) -> None:
    video = _video(clip, clip)
    found = list(iter_frames(video, select=[7, 2, 14, 99]))
    assert [frame.frame for frame in found] == [2, 7, 14]
    assert abs(float(found[2].image.mean()) - 40) < 6


def test_a_chapter_starts_where_the_one_before_ends(clip: Path) -> None:
    end_ns = read_chapter(clip).end_ns
    assert end_ns >= _MILLISECONDS[-1] * 1_000_000
    times = frame_times(_video(clip, clip))
    assert times.frame.tolist() == list(range(24))
    assert times.t_ns[12] - times.t_ns[0] == end_ns


def test_the_frames_file_wins(clip: Path, tmp_path: Path) -> None:
    path = tmp_path / "front_frames.csv"
    path.write_text("frame,t_ns\n" + "".join(f"{i},{7000 + i}\n" for i in range(11)))
    video = _video(clip, start_ns=None, frames=path)
    warnings: list[str] = []
    found = [(frame.frame, frame.t_ns) for frame in iter_frames(video, warn=warnings.append)]
    assert found == [(i, 7000 + i) for i in range(11)]
    assert "lists 11 frames, the video has 12" in warnings[0]


def test_a_video_without_a_start_says_so(clip: Path) -> None:
    assert "start_ns" in frame_times(_video(clip, start_ns=None)).warnings[0]


@pytest.mark.parametrize("content", [b"", b"no video at all", b"\0" * 5000])
def test_no_video_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "front.mp4"
    path.write_bytes(content)
    with pytest.raises(InputError, match="no readable video"):
        read_chapter(path)


def test_an_unreadable_chapter_ends_the_numbering(clip: Path, tmp_path: Path) -> None:
    broken = tmp_path / "front_2.mp4"
    broken.write_bytes(b"no video")
    times = frame_times(_video(clip, broken, clip))
    assert len(times) == 12
    assert any("left out too" in text for text in times.warnings)


@pytest.mark.parametrize("stamps", ["", "frame,t_ns\n0,5\n1,6\n"])
def test_a_camera_without_a_readable_chapter_has_no_frames(tmp_path: Path, stamps: str) -> None:
    broken = tmp_path / "front.mp4"
    broken.write_bytes(b"no video")
    video = _video(broken)
    if stamps:
        (tmp_path / "frames.csv").write_text(stamps)
        video = replace(video, frames=tmp_path / "frames.csv")
    warnings: list[str] = []
    assert list(iter_frames(video, warn=warnings.append)) == []
    assert "no readable video" in warnings[0]


def test_a_cut_video_gives_what_is_there(tmp_path: Path) -> None:
    whole = _make(tmp_path / "front.mkv", list(range(0, 4000, 40)))
    data = whole.read_bytes()
    whole.write_bytes(data[: len(data) // 2])
    warnings: list[str] = []
    found = [frame.frame for frame in iter_frames(_video(whole), warn=warnings.append)]
    assert 10 < len(found) < 100
    assert found == list(range(len(found)))


def test_damaged_pictures_are_counted_and_the_rest_is_read(tmp_path: Path) -> None:
    path = _make(tmp_path / "front.avi", list(range(0, 4000, 40)))
    expected = len(read_chapter(path).pts_ns)
    data = bytearray(path.read_bytes())
    start = len(data) // 3
    data[start : start + 3000] = bytes(3000)
    path.write_bytes(data)
    warnings: list[str] = []
    found = [frame.frame for frame in iter_frames(_video(path), warn=warnings.append)]
    assert expected // 2 < len(found) <= expected
    assert found == sorted(set(found))


@pytest.mark.parametrize(
    ("matrix", "said"),
    [((0, 1, -1, 0), "turned by"), ((-1, 0, 0, -1), "180 deg"), ((1, 0, 0, 1), "")],
)
def test_pictures_that_are_to_be_turned_are_told(
    clip: Path, tmp_path: Path, matrix: tuple[int, int, int, int], said: str
) -> None:
    data = bytearray(clip.read_bytes())
    # the track header's matrix, 16.16 fixed point (ISO/IEC 14496-12, 8.3.2)
    at = data.index(b"tkhd") + 44
    a, b, c, d = (round(value * 65536).to_bytes(4, "big", signed=True) for value in matrix)
    data[at : at + 8], data[at + 12 : at + 20] = a + b, c + d
    path = tmp_path / "turned.mp4"
    path.write_bytes(data)
    warnings = read_chapter(path).warnings
    assert len(warnings) == (1 if said else 0)
    assert all(said in text and "upright.mp4" in text for text in warnings)
