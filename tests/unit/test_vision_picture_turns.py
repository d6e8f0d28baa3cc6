"""A late, quick or turned video, told by how its pictures turn in bends, without any sign."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from automap.records import Camera, PictureTurns, Trajectory, VideoFrame
from automap.vision.camera_path import camera_path
from automap.vision.picture_turns import Steps, frames_to_follow, judged, picture_turns
from automap.vision.search import default_camera
from tests.slow_cases import others_slow

CAMERA = replace(default_camera(640, 360), time_offset_sd=0.1)
S = 1_000_000_000
BENDS = ((20.0, 1.5), (50.0, -1.2), (90.0, 0.8), (120.0, 1.5))
"""Middle of each bend, s, and its angle, rad."""


def path() -> Trajectory:
    """Two and a half minutes with four bends."""
    t = np.arange(0.0, 150.0, 0.02)
    yaw = sum(angle / (1.0 + np.exp(-(t - at) / 0.5)) for at, angle in BENDS)
    rpy = np.column_stack([0.01 * np.sin(t), 0.01 * np.sin(1.3 * t), yaw])
    one, three = np.zeros(len(t)), np.full((len(t), 3), 0.1)
    t_ns = np.round(t * S).astype(np.int64)
    return Trajectory(t_ns, t, one, one, one, np.zeros((len(t), 3)), rpy, three, three, three)


def told(
    late_s: float = 0.0,
    rate: float = 0.0,
    looks: tuple[float, ...] = (1, 1, 1),
    seed: int = 0,
    noise: float = 0.004,
    follows_s: float = 0.0,
    own: bool = False,
    camera: Camera = CAMERA,
) -> PictureTurns:
    """What is said of frames that show what was ``late_s`` and ``rate`` of the time before their
    stamps, whose turns look multiplied by ``looks``, of a camera that follows the vehicle in
    ``follows_s``, or with bends of their ``own``."""
    rng = np.random.default_rng(seed)
    drive = path()
    shown = followed(drive, follows_s) if follows_s else drive

    def path_of(t_ns: np.ndarray) -> object:
        return camera_path(drive, CAMERA, t_ns)

    stamps = np.arange(10 * S, 140 * S, S // 10)
    bends = []
    for rows in frames_to_follow(path_of(stamps), stamps):  # type: ignore[arg-type]
        at = stamps[rows]
        true = at - np.round(1e9 * late_s + rate * at).astype(np.int64)
        seen = camera_path(shown, CAMERA, true)
        turn = np.array(
            [vector(seen.C_cam_ref[k] @ seen.C_cam_ref[k + 1].T) for k in range(len(at) - 1)]
        )
        # leaks of what is near, which last, and noise
        turn = 0.9 * turn * looks + rng.normal(0.0, noise, turn.shape)
        if own:
            turn = rng.normal(0.0, noise, turn.shape)
            turn[:, 2] += 0.05 * np.sign(np.sin(np.arange(len(turn)) / 8.0))
        bends.append(Steps(at[:-1], at[1:], turn))
    return judged(camera, path_of, bends)  # type: ignore[arg-type]


def followed(drive: Trajectory, tau_s: float) -> Trajectory:
    """A path whose heading is a low pass of the vehicle's."""
    yaw = drive.rpy[:, 2].copy()
    for k in range(1, len(yaw)):
        yaw[k] = yaw[k - 1] + (drive.rpy[k, 2] - yaw[k - 1]) * 0.02 / tau_s
    return replace(drive, rpy=np.column_stack([drive.rpy[:, :2], yaw]))


def vector(matrix: np.ndarray) -> np.ndarray:
    from automap.frames import matrix_to_rotation_vector

    return matrix_to_rotation_vector(matrix)


@pytest.mark.parametrize("seed", others_slow(range(4)))
def test_a_right_video_is_told_nothing(seed: int) -> None:
    found = told(seed=seed)
    assert found.allowed
    assert abs(found.offset_s) < 2.0 * found.offset_sd_s < CAMERA.time_offset_sd
    assert found.told("front") == ""
    assert found.bends == 4


def test_bends_and_the_manifest_are_combined_where_they_agree() -> None:
    """A start known to a second: bends say it to hundredths, and nothing is wrong."""
    found = told(0.4, camera=replace(CAMERA, time_offset_sd=1.0))
    assert found.allowed
    assert found.told("front") == ""
    assert found.offset_s == pytest.approx(-0.4, abs=3.0 * found.offset_sd_s)
    assert found.offset_sd_s < 0.05
    stamp = np.array([80 * S])
    assert found.corrected(stamp) - stamp == pytest.approx(-0.4e9, abs=0.15e9)


@pytest.mark.slow
def test_bends_add_nothing_to_a_manifest_that_knows_better() -> None:
    assert told(0.0, camera=replace(CAMERA, time_offset_sd=0.02)) == PictureTurns(4)


@pytest.mark.slow
def test_a_picture_that_may_follow_slowly_is_not_moved() -> None:
    """A gimbal's low pass in noise looks like a lag that the manifest allows."""
    found = told(follows_s=0.15, noise=0.006, camera=replace(CAMERA, time_offset_sd=1.0))
    assert found.allowed
    assert found.offset_s == 0.0
    assert 0.1 < found.offset_sd_s < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("late_s", [-1.5, 0.7])
def test_late_frames_are_told_and_by_how_much(late_s: float) -> None:
    found = told(late_s)
    assert found.offset_s == pytest.approx(-late_s, abs=4 * found.offset_sd_s)
    assert found.offset_sd_s < 0.05
    assert not found.pictures
    assert found.rate == 0.0


def test_quick_stamps_are_told_and_set_right() -> None:
    found = told(rate=0.02)
    stamp = np.array([80 * S])
    true = stamp - np.round(0.02 * stamp).astype(np.int64)
    assert found.rate == pytest.approx(-0.02, abs=0.003)
    assert abs(found.corrected(stamp) - true)[0] < 0.2e9


@pytest.mark.parametrize(
    ("looks", "name"), others_slow([((-1, 1, -1), "mirrored"), ((1, -1, -1), "upside down")])
)
def test_a_turned_picture_is_told(looks: tuple[float, ...], name: str) -> None:
    found = told(looks=looks)
    assert name in found.pictures
    assert abs(found.offset_s) < 4 * found.offset_sd_s


@pytest.mark.slow
def test_turned_and_late() -> None:
    found = told(0.7, looks=(1, -1, -1))
    assert found.pictures
    assert found.offset_s == pytest.approx(-0.7, abs=0.1)
    assert "its picture is mirrored or upside down" in found.told("front")


@pytest.mark.slow
def test_pictures_that_turn_by_themselves_say_nothing() -> None:
    """A video of another drive: no bend agrees."""
    found = told(own=True)
    assert found == PictureTurns(0, unlike=4)
    assert "check that the video is of this drive" in found.told("front")
    assert PictureTurns(0, unlike=1).told("front") == PictureTurns(3).told("front") == ""


def test_a_straight_road_has_nothing_to_follow() -> None:
    drive = path()
    stamps = np.arange(60 * S, 80 * S, S // 10)
    assert frames_to_follow(camera_path(drive, CAMERA, stamps), stamps) == []


@pytest.mark.slow
def test_a_picture_that_follows_slowly_is_not_late() -> None:
    """A gimbal's low pass of 0.6 s looks half a second late: then that is how unsure it is."""
    found = told(follows_s=0.6)
    assert found.offset_s == 0.0
    assert 0.3 < found.offset_sd_s < 0.8
    assert "gimbal" in found.told("front")


@pytest.mark.slow
def test_noise_and_what_does_not_move_are_no_other_video() -> None:
    """Of a video of something else bends are asked for, elsewhere than on the path."""
    assert told(looks=(0, 0, 0), noise=0.02) == PictureTurns(0)


def test_still_pictures_show_no_background() -> None:
    """Writing or dirt before the dark stays where it is while the path bends."""
    rng = np.random.default_rng(5)
    still = rng.integers(0, 255, (360, 640, 3)).astype(np.uint8)
    stamps = np.arange(10 * S, 140 * S, S // 10)

    def pictures(frames: np.ndarray) -> Iterator[VideoFrame]:
        for frame in frames.tolist():
            yield VideoFrame(frame, int(stamps[frame]), still)

    drive = path()
    found = picture_turns(
        CAMERA, lambda t_ns: camera_path(drive, CAMERA, t_ns), stamps, np.arange(1300), pictures
    )
    assert found == PictureTurns(0)
