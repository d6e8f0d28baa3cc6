"""Tracks against a world whose signs are known: one track a sign, and one sign a track."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.frames import rpy_to_matrix
from automap.geolocation import limits
from automap.records import Detections, FloatArray, IntArray
from automap.vision.camera_motion import Motion, guessed_motion, motion_on_path
from automap.vision.camera_path import CameraPath
from automap.vision.detector import FoundSigns
from automap.vision.search import default_camera
from automap.vision.tracking import Tracker, box_tracks

CAMERA = default_camera(1280, 720)
STEP_S = 0.15


@dataclass
class World:
    """Signs [k] at ``place`` [k, 3] (forward, right, down from the start), ``size`` [k] m."""

    place: FloatArray
    size: FloatArray
    names: list[str]
    rng: np.random.Generator
    hidden: dict[int, tuple[int, int]] = field(default_factory=dict)
    missed: float = 0.0

    def boxes(self, step: int, centre: FloatArray, C: FloatArray) -> tuple[FoundSigns, list[int]]:
        """What a camera at ``centre`` sees, and which sign each box shows."""
        rows, boxes = [], []
        for k, place in enumerate(self.place):
            first, last = self.hidden.get(k, (1, 0))
            ray = C @ (place - centre)
            if ray[0] < 3.0 or first <= step <= last or self.rng.random() < self.missed:
                continue
            f = CAMERA.matrix[0, 0]
            x = CAMERA.matrix[0, 2] + f * ray[1] / ray[0]
            y = CAMERA.matrix[1, 2] + f * ray[2] / ray[0]
            half = 0.5 * f * self.size[k] / ray[0]
            box = np.array([x - half, y - half, x + half, y + half])
            box += self.rng.normal(0.0, 0.4 + 0.02 * half, 4)
            if half < 7 or box[0] < 0 or box[1] < 0 or box[2] > 1279 or box[3] > 719:
                continue
            rows.append(k)
            boxes.append(box)
        order = self.rng.permutation(len(rows))
        found = FoundSigns(
            tuple(self.names[rows[i]] for i in order),
            np.array([boxes[i] for i in order]).reshape(-1, 4),
            np.full(len(rows), 0.9),
        )
        return found, [rows[i] for i in order]


def drive(speed: float, turn_rate: float, steps: int) -> CameraPath:
    """A level path at a steady speed and turn rate."""
    yaw = turn_rate * STEP_S * np.arange(steps)
    ahead = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(steps)]) * speed * STEP_S
    centre = np.vstack([np.zeros(3), np.cumsum(ahead, axis=0)[:-1]])
    C_ref_cam = rpy_to_matrix(np.column_stack([np.zeros(steps), np.zeros(steps), yaw]))
    return CameraPath(centre, np.swapaxes(C_ref_cam, 1, 2), np.ones(steps, np.bool_))


def follow(world: World, path: CameraPath, known: bool = True) -> dict[int, set[int]]:
    """The track numbers of each sign."""
    tracker = Tracker(CAMERA)
    tracks: dict[int, set[int]] = {}
    for step in range(len(path)):
        found, shown = world.boxes(step, path.centre[step], path.C_cam_ref[step])
        motion: Motion | None = guessed_motion(STEP_S)
        if step and known:
            motion = motion_on_path(path, step - 1, step, STEP_S)
        elif step:
            # as from the pictures: the turn is known, the distance is not
            exact = motion_on_path(path, step - 1, step, STEP_S)
            assert exact is not None
            guess = guessed_motion(STEP_S)
            motion = replace(guess, C_new_old=exact.C_new_old, turn_sd=0.005)
        assert motion is not None
        numbers = tracker.step(motion, STEP_S, found)
        assert len(set(numbers.tolist())) == len(numbers)
        for sign, number in zip(shown, numbers.tolist(), strict=True):
            tracks.setdefault(sign, set()).add(number)
    return tracks


def assert_one_to_one(tracks: dict[int, set[int]], signs: int) -> None:
    assert len(tracks) == signs
    assert all(len(numbers) == 1 for numbers in tracks.values()), tracks
    assert len({n for numbers in tracks.values() for n in numbers}) == signs


def street(
    seed: int, speed: float, turn_rate: float, missed: float = 0.0
) -> tuple[World, CameraPath]:
    """Signs of four kinds beside a road, left and right in turn, 18 m apart."""
    rng = np.random.default_rng(seed)
    path = drive(speed, turn_rate, 50)
    at = np.arange(25.0, min(speed * STEP_S * 50, 130.0) + 30.0, 18.0)
    yaw = turn_rate * at / speed
    side = np.where(np.arange(len(at)) % 2, 4.5, -4.0)
    # the middle of the road: a circle, or a straight line
    chord = at * np.sinc(yaw / (2.0 * np.pi))
    ahead, right = chord * np.cos(0.5 * yaw), chord * np.sin(0.5 * yaw)
    place = np.column_stack(
        [ahead - np.sin(yaw) * side, right + np.cos(yaw) * side, -np.ones(len(at))]
    )
    names = [f"c{k % 4}" for k in range(len(at))]
    return World(place, rng.uniform(0.5, 1.0, len(at)), names, rng, missed=missed), path


@settings(max_examples=8)
@given(
    seed=st.integers(0, 10_000),
    speed=st.floats(4.0, 25.0),
    sideways=st.floats(-3.0, 3.0),
)
def test_one_track_a_sign_wherever_the_car_goes(seed: int, speed: float, sideways: float) -> None:
    turn_rate = float(np.clip(sideways / speed, -0.35, 0.35))
    tracks = follow(*street(seed, speed, turn_rate))
    assert tracks
    assert_one_to_one(tracks, len(tracks))


def test_one_track_a_sign_where_only_turns_are_known() -> None:
    """By pictures alone a sign's first box may be one of its kind that has just gone by: in two of
    851 streets, and so in one of thirty at most."""
    rng = np.random.default_rng(3)
    mixed = 0
    for seed in range(30):
        speed, sideways = rng.uniform(4.0, 25.0), rng.uniform(-3.0, 3.0)
        turn_rate = float(np.clip(sideways / speed, -0.35, 0.35))
        tracks = follow(*street(seed, speed, turn_rate), known=False)
        # a number for each sign, and a sign for each number
        together = sum(len(numbers) for numbers in tracks.values())
        mixed += not together == len(set().union(*tracks.values())) == len(tracks)
    assert mixed <= 1


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, False])
def test_missed_views_seldom_mix_signs(known: bool) -> None:
    rng = np.random.default_rng(7)
    signs = extra = 0
    for seed in range(12):
        speed = rng.uniform(5.0, 20.0)
        turn_rate = rng.uniform(-2.0, 2.0) / speed
        tracks = follow(*street(seed, speed, turn_rate, missed=0.2), known)
        signs += len(tracks)
        extra += sum(len(numbers) - 1 for numbers in tracks.values())
    assert signs > 60
    assert extra <= 0.04 * signs


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("same", [True, False])
def test_signs_side_by_side_stay_two(known: bool, same: bool) -> None:
    place = np.array([[60.0, 3.5, -1.0], [60.0, 4.3, -1.0], [60.0, 3.5, -1.8]])
    names = ["a", "a", "a"] if same else ["a", "b", "c"]
    world = World(place, np.full(3, 0.7), names, np.random.default_rng(5))
    assert_one_to_one(follow(world, drive(13.0, 0.0, 40), known), 3)


@pytest.mark.parametrize("known", [True, False])
def test_a_sign_behind_a_lorry_for_a_second_stays_one(known: bool) -> None:
    place = np.array([[70.0, 4.0, -1.2], [70.0, -4.0, -1.2]])
    hidden = {0: (12, 19)}
    world = World(place, np.full(2, 0.75), ["a", "a"], np.random.default_rng(2), hidden)
    assert_one_to_one(follow(world, drive(13.0, 0.02, 40), known), 2)


def test_waiting_beside_a_hidden_sign_does_not_lose_it() -> None:
    place = np.array([[18.0, 3.0, -1.0]])
    hidden = {0: (5, 90)}
    world = World(place, np.array([0.7]), ["a"], np.random.default_rng(3), hidden)
    assert_one_to_one(follow(world, drive(0.0, 0.0, 100)), 1)


def test_two_signs_one_after_the_other_are_two() -> None:
    # the second comes into view where the first has just left it
    place = np.array([[20.0, 4.0, -1.0], [60.0, 4.0, -1.0]])
    hidden = {1: (0, 9)}
    world = World(place, np.full(2, 0.7), ["a", "a"], np.random.default_rng(4), hidden)
    assert_one_to_one(follow(world, drive(13.0, 0.0, 35)), 2)


def test_a_box_cut_by_the_edge_keeps_its_track() -> None:
    tracker = Tracker(CAMERA)
    still = Motion(np.eye(3), np.zeros(3), 0.002, np.full(3, 0.05))
    whole = FoundSigns(("a",), np.array([[1200.0, 100.0, 1270.0, 170.0]]), np.ones(1))
    cut = FoundSigns(("a",), np.array([[1225.0, 90.0, 1279.0, 172.0]]), np.ones(1))
    assert tracker.step(still, 0.0, whole).tolist() == tracker.step(still, 0.1, cut).tolist()


def found_alone(world: World, path: CameraPath) -> tuple[Detections, IntArray, CameraPath]:
    """Boxes of a detector that looks at each frame by itself, which sign each shows, and the path
    at the frames that have some."""
    rows, shown, boxes, names = [], [], [], []
    for step in range(len(path)):
        found, owner = world.boxes(step, path.centre[step], path.C_cam_ref[step])
        rows += [step] * len(owner)
        shown += owner
        boxes.append(found.box)
        names += found.class_name
    frame, n = np.array(rows, np.int64), len(rows)
    t_ns = frame * np.int64(STEP_S * 1e9)
    alone = np.full(n, -1, np.int64)
    data = Detections(
        frame, t_ns, np.array(names, object), np.concatenate(boxes), np.full(n, 0.9), alone
    )
    known = np.unique(frame)
    part = CameraPath(path.centre[known], path.C_cam_ref[known], path.known[known])
    return data, np.array(shown, np.int64), part


@pytest.mark.parametrize("missed", [0.0, 0.2])
def test_boxes_of_single_frames_get_the_tracks_of_their_signs(missed: float) -> None:
    found, shown, path = found_alone(*street(3, 12.0, 0.05, missed))
    track = box_tracks(found, CAMERA, path)
    for sign in np.unique(shown):
        numbers, count = np.unique(track[shown == sign], return_counts=True)
        assert count.max() >= 0.9 * count.sum(), numbers
    of_track = [np.unique(shown[track == number]) for number in np.unique(track[track >= 0])]
    assert all(len(signs) == 1 for signs in of_track)


def test_what_is_seen_once_has_no_track() -> None:
    # photographs 40 m apart: each sign is in one of them
    place = np.array([[20.0 + 40.0 * k, 4.0, -1.0] for k in range(6)])
    world = World(place, np.full(6, 0.7), ["a"] * 6, np.random.default_rng(4))
    path = drive(40.0 / STEP_S, 0.0, 6)
    found, shown, path = found_alone(world, path)
    first = np.unique(shown, return_index=True)[1]
    some = replace(found, **{k: v[first] for k, v in vars(found).items() if hasattr(v, "shape")})
    some = replace(some, t_ns=some.frame * 3_000_000_000)
    assert len(some) == 6
    assert (box_tracks(some, CAMERA, path) == -1).all()
    none = replace(found, **{k: v[:0] for k, v in vars(found).items() if hasattr(v, "shape")})
    assert len(box_tracks(none, CAMERA, None)) == 0


@pytest.mark.parametrize("known", [True, False])
def test_a_lorry_that_keeps_its_distance_is_one_thing(known: bool) -> None:
    path = drive(12.0, 0.02, 100)
    rng = np.random.default_rng(6)
    half = 0.5 * 0.75 * CAMERA.matrix[0, 0] / (18.0 + rng.normal(0.0, 0.4, 100))
    middle = CAMERA.matrix[:2, 2] + np.column_stack([6.0 + 0.0 * half, -20.0 + 0.0 * half])
    box = np.column_stack([middle - half[:, None], middle + half[:, None]])
    frame = np.arange(100)
    found = Detections(
        frame, frame * np.int64(STEP_S * 1e9), np.full(100, "a", object),
        box + rng.normal(0.0, 1.0, (100, 4)), np.full(100, 0.9), np.full(100, -1, np.int64),
    )  # fmt: skip
    numbers, count = np.unique(
        box_tracks(found, CAMERA, path if known else None), return_counts=True
    )
    # it does what no sign does: now and then a track ends, of more than are needed to tell it
    assert count[numbers >= 0].sum() > 95
    assert count[numbers >= 0].min() > limits.CARRIER_VIEWS
