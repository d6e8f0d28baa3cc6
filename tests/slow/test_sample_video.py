"""The detector on the sample drive's video, against where its signs really are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from automap.io.drive import load_drive
from automap.io.frame_times import frame_times
from automap.io.video import read_chapter
from automap.io.video_decode import iter_frames
from automap.simulation.camera import camera_views, visible_box
from automap.simulation.scene import build_scene
from automap.simulation.trajectory import drive_motion
from automap.vision.network import default_detector
from automap.vision.search import above
from pipeline.simulate.command import load_scenario

PROJECT = Path(__file__).resolve().parents[2]
EVERY = 6
LEAST = 0.3


@pytest.mark.slow
def test_signs_are_found_named_and_placed() -> None:
    scenario = load_scenario(PROJECT / "configs" / "scenarios" / "sample.toml")
    assert scenario.camera is not None
    streams = np.random.SeedSequence(scenario.seed).spawn(5)
    motion = drive_motion(scenario, np.random.default_rng(streams[0]))
    scene = build_scene(scenario, motion, np.random.default_rng(streams[3]))
    video = load_drive(PROJECT / "data" / "sample-drive").videos["front"]
    # the container's stamps are the exact times of exposure, from the first frame on
    chosen = frame_times(video).frame[::EVERY]
    detector = default_detector("AU")
    errors, shares, missed, wrong, false, large = [], [], 0, 0, 0, 0
    first_s = 0.1 + _first_jitter(streams[4], scenario.camera.frame_jitter_s)
    exact = _exposures(video.chapters[0])
    for picture in iter_frames(video, chosen):
        found = above(detector.detect(picture.image), LEAST)
        t = np.array([first_s + exact[picture.frame]])
        view = camera_views(motion, scenario.camera, t, scene.ref)[0]
        used: set[int] = set()
        for sign in scene.signs:
            box = visible_box(view, sign)
            if box is None:
                continue
            size = box[2:] - box[:2]
            offsets = (found.box[:, :2] + found.box[:, 2:] - box[:2] - box[2:]) / 2
            near = np.flatnonzero((np.abs(offsets) < 0.35 * size + 1).all(axis=1))
            used |= set(near.tolist())
            if size.max() < 24.0:
                continue
            large += 1
            if len(near) == 0:
                missed += 1
                continue
            shares.append(offsets[near[0]] / size.max())
            if size.max() < 60.0:
                errors.append(offsets[near[0]])
            name = found.class_name[near[0]]
            wrong += name != sign.name and "unknown" not in name
        false += len(found) - len(used)
    assert large > 60
    assert missed <= 0.05 * large
    assert wrong <= 0.05 * large
    # faces far away whose truth is too small to be listed are among them
    assert false <= 25
    assert np.sqrt(np.mean(np.square(errors))) < 1.0
    # the nearest stand in view for seconds at a stop: one error many times over
    assert np.abs(np.mean(errors, axis=0)).max() < 0.3
    assert np.sqrt(np.mean(np.square(shares))) < 0.05


def _exposures(path: Path) -> np.ndarray:
    pts = read_chapter(path).pts_ns
    return (pts - pts[0]) * 1e-9


def _first_jitter(stream: np.random.SeedSequence, sigma: float) -> float:
    return float(np.random.default_rng(stream).standard_normal() * sigma)
