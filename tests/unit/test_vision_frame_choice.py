"""Which frames are searched: by distance and turn, by time, and not while nothing moves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.frames import rpy_to_matrix
from automap.records import FloatArray, FrameTimes
from automap.vision.camera_path import CameraPath
from automap.vision.frame_choice import ChoiceRules, every_frame, plan_frames

RULES = ChoiceRules()


def times(seconds: float, rate: float, jitter: float = 0.0, seed: int = 0) -> FrameTimes:
    n = int(seconds * rate)
    t = np.arange(n) / rate + np.random.default_rng(seed).uniform(-jitter, jitter, n) / rate
    return FrameTimes(np.arange(n), np.rint(t * 1e9).astype(np.int64) + 10**15)


def path(distance: FloatArray, yaw: FloatArray | None = None) -> CameraPath:
    n = len(distance)
    zero = np.zeros(n)
    angles = np.column_stack([zero, zero, zero if yaw is None else yaw])
    C = np.swapaxes(rpy_to_matrix(angles), 1, 2)
    return CameraPath(np.column_stack([distance, zero, zero]), C, np.ones(n, np.bool_))


@settings(max_examples=30)
@given(speed=st.floats(0.5, 20.0), rate=st.sampled_from([10.0, 25.0, 30.0, 60.0]))
def test_frames_are_a_step_of_road_apart(speed: float, rate: float) -> None:
    frames = times(30.0, rate, 0.05)
    distance = speed * (frames.t_ns - frames.t_ns[0]) * 1e-9
    plan = plan_frames(frames, path(distance), RULES)
    gaps = np.diff(distance[plan.frame])
    per_frame = speed / rate
    # never further apart than a step and the frame that it falls into
    assert gaps.max() <= max(RULES.step_m, RULES.shortest_s * speed) + 1.6 * per_frame
    seconds = np.diff(frames.t_ns[plan.frame]) * 1e-9
    assert seconds.max() <= RULES.idle_s + 1.5 / rate
    road = distance[-1] / max(RULES.step_m, per_frame)
    assert len(plan) <= 1.25 * road + 30.0 / RULES.idle_s + 2
    coarse = distance[plan.frame[plan.coarse]]
    assert (
        np.diff(coarse).max() <= 2 * max(RULES.step_m, RULES.shortest_s * speed) + 2.7 * per_frame
    )
    assert not plan.still.any()


def test_a_turn_counts_like_a_stretch_of_road() -> None:
    frames = times(6.0, 30.0)
    yaw = np.linspace(0.0, np.radians(90.0), len(frames))
    plan = plan_frames(frames, path(np.zeros(len(frames)), yaw), RULES)
    assert 25 <= len(plan) <= 36


def test_a_standstill_is_looked_at_now_and_then() -> None:
    frames = times(60.0, 30.0)
    plan = plan_frames(frames, path(np.zeros(len(frames))), RULES)
    assert 25 <= len(plan) <= 32
    assert plan.coarse.all()


def test_whole_searches_are_never_further_apart_than_told() -> None:
    for rate, share in ((30.0, 1 / 3), (15.0, 1.0), (60.0, 1 / 6)):
        frames = times(2.0, rate)
        plan = every_frame(frames, 0.105)
        assert len(plan) == len(frames)
        whole = frames.t_ns[plan.coarse]
        assert plan.coarse[0]
        assert plan.coarse[-1]
        assert np.diff(whole).max() <= 0.105e9
        assert plan.coarse.mean() == pytest.approx(share, abs=0.03)


@pytest.mark.parametrize("rate", [10.0, 29.97, 60.0])
def test_without_a_path_time_decides(rate: float) -> None:
    frames = times(20.0, rate, 0.1)
    plan = plan_frames(frames, None, RULES)
    assert len(plan) / 20.0 == pytest.approx(RULES.speed / RULES.step_m, rel=0.12)
    assert plan.coarse.sum() == pytest.approx(len(plan) / 2, abs=3)
    assert plan.still.all()


def test_where_the_path_is_unknown_time_decides() -> None:
    frames = times(20.0, 30.0)
    half = len(frames) // 2
    known = np.arange(len(frames)) < half
    standing = path(np.zeros(len(frames)))
    plan = plan_frames(frames, CameraPath(standing.centre, standing.C_cam_ref, known), RULES)
    assert (plan.frame < half).sum() <= 7
    assert (plan.frame >= half).sum() >= 60


def test_every_frame_is_every_frame() -> None:
    frames = times(1.0, 30.0)
    plan = every_frame(frames)
    assert plan.frame.tolist() == list(range(30))
    assert plan.coarse.all()


def test_no_frames_need_no_search() -> None:
    assert len(plan_frames(times(0.0, 30.0), None, RULES)) == 0
    one = plan_frames(times(0.04, 30.0), None, RULES)
    assert one.frame.tolist() == [0]
    assert one.coarse.tolist() == [True]
