"""Quantities along a path and users' effects of a camera, by geometry written down otherwise."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from automap.earth import gravity
from automap.effects import Signals, UserTerm, user_effect
from automap.effects.camera import as_stated, direction_by_point, direction_by_turn
from automap.effects.camera_kernels import (
    FOCAL,
    LEVER_ARM,
    SHUTTER,
    TIME,
    TURN,
    all_columns,
    bend,
    distort,
    undistort,
)
from automap.effects.camera_user import depends_on_the_drive, drift, user_columns
from automap.effects.path_signals import PathSignals, path_signals
from automap.effects.signals import travel_of_fixes
from automap.effects.term_sums import AXES, MATRIX, SIGNAL_ONE, new_room, sum_terms
from automap.effects.term_sums import TURN as TERM_TURN
from automap.effects.user import set_user_effects
from automap.records import Camera, Detections, FloatArray, ImuData, Trajectory


def test_a_climb_is_told_by_the_weight_along_the_road() -> None:
    t = np.arange(0.0, 12.0, 0.02)
    speed, slope, n = 8.0 + 0.5 * t, 0.06, len(t)
    vel = np.column_stack([speed * np.cos(slope), np.zeros_like(t), -speed * np.sin(slope)])
    path = Trajectory(
        t_ns=np.rint(t * 1e9).astype(np.int64), gps_s=1e9 + t,
        lat_rad=np.full(n, 0.6), lon_rad=np.full(n, 0.2), height_m=np.full(n, 300.0),
        vel_ned=vel, rpy=np.tile([0.0, slope, 0.0], (n, 1)),
        sd_pos_ned=np.ones((n, 3)), sd_vel_ned=np.ones((n, 3)), sd_rpy=np.ones((n, 3)),
    )  # fmt: skip
    at = path_signals(path, None).at(np.array([2, 6]) * 10**9)
    assert at.climb == pytest.approx(np.array([9.0, 11.0]) * np.sin(slope), rel=0.01)


@pytest.mark.parametrize("rate", [0.3, -0.2])
def test_quantities_along_a_bend_are_those_of_the_circle(rate: float) -> None:
    """A banked bend that is driven faster and faster: rates and forces by SciPy's rotations."""
    t = np.arange(0.0, 12.0, 0.02)
    heading = 3.0 + rate * t
    speed = 8.0 + 0.5 * t
    vel = np.column_stack([speed * np.cos(heading), speed * np.sin(heading), np.zeros_like(t)])
    roll = 0.1
    yaw = (heading + np.pi) % (2.0 * np.pi) - np.pi
    n = len(t)
    path = Trajectory(
        t_ns=np.int64(5 * 10**9) + np.rint(t * 1e9).astype(np.int64), gps_s=1e9 + t,
        lat_rad=np.full(n, 0.6), lon_rad=np.full(n, 0.2), height_m=np.full(n, 300.0),
        vel_ned=vel, rpy=np.column_stack([np.full(n, roll), np.zeros(n), yaw]),
        sd_pos_ned=np.ones((n, 3)), sd_vel_ned=np.ones((n, 3)), sd_rpy=np.ones((n, 3)),
    )  # fmt: skip
    warm = ImuData(
        np.array([4, 15]) * 10**9, np.zeros((2, 3)), np.zeros((2, 3)), np.array([20.0, 31.0])
    )
    found = path_signals(path, warm)
    at = found.at(np.array([7 * 10**9, 11 * 10**9 + 10**7]))
    wanted_t = np.array([2.0, 6.01])
    assert at.time == pytest.approx(wanted_t)
    assert at.speed == pytest.approx(8.0 + 0.5 * wanted_t)
    turned = at.heading - (3.0 + rate * wanted_t)
    assert turned == pytest.approx(turned[0] + np.zeros(2), abs=1e-6)
    assert np.cos(turned) == pytest.approx([1.0, 1.0])
    assert at.acceleration == pytest.approx([0.5, 0.5], abs=1e-3)
    # a yaw in the axes of a body that leans
    assert at.rate_x == pytest.approx([0.0, 0.0], abs=1e-6)
    assert at.rate_y == pytest.approx([rate * np.sin(roll)] * 2, abs=1e-6)
    assert at.rate_z == pytest.approx([rate * np.cos(roll)] * 2, abs=1e-6)
    assert at.rate == pytest.approx([abs(rate)] * 2, abs=1e-6)
    assert at.lateral_acceleration == pytest.approx((8.0 + 0.5 * wanted_t) * rate * np.cos(roll))
    level = np.column_stack(
        [[0.5, 0.5], (8.0 + 0.5 * wanted_t) * rate, np.full(2, -float(gravity(0.6, 300.0)))]
    )
    force = Rotation.from_euler("x", roll).inv().apply(level)
    found_force = np.column_stack([at.force_x, at.force_y, at.force_z])
    np.testing.assert_allclose(found_force, force, atol=3e-3)
    assert at.force == pytest.approx(np.linalg.norm(force, axis=1), abs=3e-3)
    assert at.temperature == pytest.approx([23.0, 27.01])
    assert at.temperature_rate == pytest.approx([1.0, 1.0])
    assert path_signals(path).at(path.t_ns[:1]).temperature_rate == pytest.approx([0.0])


@pytest.fixture
def nodding() -> Iterator[None]:
    """A user's camera that turns with the rate and is late with the speed."""
    terms = (
        UserTerm("nod", "camera_pitch", lambda s: s.rate_y, 0.1),
        UserTerm("twist", "camera_yaw", lambda s: 2.0 * s.heading, 0.1),
        UserTerm("late", "camera_time", lambda s: s.speed, 0.1),
    )
    set_user_effects([user_effect("soft_mount", "a mount that gives way", *terms)])
    yield
    set_user_effects([])


def test_users_effects_of_a_camera_turn_and_delay_it_by_their_signals(nodding: None) -> None:
    n = 4
    rng = np.random.default_rng(1)
    signals = Signals(*rng.uniform(0.5, 2.0, (19, n)))
    values = {"soft_mount": {"nod": 0.1, "late": 0.02}}
    turn, late = drift(values, signals)
    np.testing.assert_allclose(
        turn, np.column_stack([np.zeros(n), 0.1 * signals.rate_y, np.zeros(n)])
    )
    np.testing.assert_allclose(late, 0.02 * signals.speed)
    columns = rng.normal(size=(n, 3, 11))
    by_kernel = user_columns(signals, columns)
    factors = (signals.rate_y, 2.0 * signals.heading, signals.speed)
    for k, (column, factor) in enumerate(zip((TURN + 1, TURN + 2, TIME), factors, strict=True)):
        np.testing.assert_allclose(by_kernel[:, :, k], columns[:, :, column] * factor[:, None])
    assert depends_on_the_drive()
    assert depends_on_the_drive(values)
    assert not depends_on_the_drive({"camera_focal": {"relative": 0.1}})
    set_user_effects([])
    assert user_columns(signals, columns).shape == (n, 3, 0)
    assert not depends_on_the_drive()


def test_boxes_as_stated_are_those_of_a_camera_that_neither_turns_nor_reads_row_by_row(
    nodding: None,
) -> None:
    """Edges by SciPy's rotations and a camera without a lens error; stamps by row and speed."""
    n = 5
    rng = np.random.default_rng(2)
    low = rng.uniform([100.0, 100.0], [900.0, 500.0], (n, 2))
    box = np.hstack([low, low + rng.uniform(10.0, 60.0, (n, 2))])
    K = np.array([[1000.0, 0.0, 640.0], [0.0, 990.0, 360.0], [0.0, 0.0, 1.0]])
    view = Camera(1280, 720, K, np.zeros(5), np.zeros(3), np.zeros(3), 0.01, 0.5, 0.1)
    t_ns = np.int64(10**9) + np.arange(n) * np.int64(10**9)
    found = Detections(np.arange(n), t_ns, np.full(n, "a", object), box, np.ones(n), np.full(n, -1))
    values = {
        "soft_mount": {"nod": 0.3, "twist": 0.05, "late": 0.01}, "rolling_shutter": {"s": 0.03}
    }  # fmt: skip
    signals = Signals(np.arange(19.0), *np.cumsum(rng.uniform(0.01, 0.03, (18, 19)), axis=1))
    path = PathSignals(10**9, signals)
    after = as_stated(found, view, values, path)
    at = signals.at(np.arange(0.5, n))
    row = 0.03 * ((0.5 * (box[:, 1] + box[:, 3]) + 0.5) / 720 - 0.5)
    late = row + 0.01 * at.speed
    assert (after.t_ns - t_ns) * 1e-9 == pytest.approx(late, abs=2e-9)
    nod, twist = 0.3 * at.rate_y, 0.1 * at.heading
    C = Rotation.from_euler("ZYX", np.column_stack([twist, nod, np.zeros(n)]))
    middle = 0.5 * (box[:, :2] + box[:, 2:])
    for k in range(4):
        pixel = middle.copy()
        pixel[:, k % 2] = box[:, k]
        flat = (pixel - K[:2, 2]) / [1000.0, 990.0]
        ray = C.apply(np.column_stack([np.ones(n), flat]))
        axis = k % 2
        wanted = K[axis, axis] * ray[:, 1 + axis] / ray[:, 0] + K[axis, 2]
        assert after.box[:, k] == pytest.approx(wanted)
    plain = as_stated(found, view, {"rolling_shutter": {"s": 0.03}})
    assert (plain.t_ns - t_ns) * 1e-9 == pytest.approx(row, abs=2e-9)
    np.testing.assert_array_equal(plain.box, box)
    # without a turn boxes are not touched
    only_late = as_stated(found, view, {"soft_mount": {"late": 0.01}}, path)
    np.testing.assert_array_equal(only_late.box, box)


def test_what_a_camera_sees_of_a_point_changes_with_point_and_turn() -> None:
    rng = np.random.default_rng(3)
    q = rng.uniform([5.0, -3.0, -3.0], [20.0, 3.0, 3.0], (6, 3))

    def seen(points: FloatArray) -> FloatArray:
        return np.column_stack([points[:, 1:] / points[:, :1], -np.log(points[:, 0])])

    h = 1e-6
    for axis, e in enumerate(h * np.eye(3)):
        numeric = (seen(q + e) - seen(q - e)) / (2.0 * h)
        np.testing.assert_allclose(direction_by_point(q)[:, :, axis], numeric, atol=1e-8)
        turn = Rotation.from_rotvec(e)
        numeric = (seen(turn.inv().apply(q)) - seen(turn.apply(q))) / (2.0 * h)
        np.testing.assert_allclose(direction_by_turn(q)[:, :, axis], numeric, atol=1e-8)


def lens_with_everything() -> FloatArray:
    """All of OpenCV's coefficients at once, and a sensor that is tilted both ways."""
    tilt = np.eye(3) + 0.02 * np.random.default_rng(4).standard_normal((3, 3))
    some = [-0.2, 0.05, 2e-3, -3e-3, 0.01, 0.1, -0.04, 0.02, 4e-3, -2e-3, 3e-3, 1e-3]
    return np.concatenate([some, tilt.ravel()])


@pytest.mark.parametrize(("y", "z"), [(0.3, -0.2), (-0.4, 0.25), (0.1, 0.35)])
def test_a_lenss_derivatives_are_those_of_what_it_bends(y: float, z: float) -> None:
    lens, h = lens_with_everything(), 1e-6
    out, up, down = np.zeros((3, 2, 5))
    bend(lens, y, z, out)
    ends = []
    for k, place in ((1, None), (2, None), (3, 0), (4, 1)):
        for end, sign in ((up, 1.0), (down, -1.0)):
            other = lens.copy()
            if place is not None:
                other[place] += sign * h
            bend(other, y + sign * h * (k == 1), z + sign * h * (k == 2), end)
        ends.append((up[:, 0] - down[:, 0]) / (2.0 * h))
    np.testing.assert_allclose(out[:, 1:], np.array(ends).T, atol=1e-8)
    # and the way there and back is one
    there = distort(lens, np.array([[y, z]]))
    np.testing.assert_allclose(there[0], out[:, 0], atol=1e-15)
    np.testing.assert_allclose(undistort(lens, there, 1e-9), [[y, z]], atol=1e-9)


def test_columns_of_a_camera_are_the_derivatives_of_what_it_sees_through_any_lens() -> None:
    lens, h = lens_with_everything(), 1e-6
    rng = np.random.default_rng(5)
    n = 5
    q = rng.uniform([8.0, -3.0, -3.0], [20.0, 3.0, 3.0], (n, 3))
    height, share = rng.uniform(0.02, 0.08, n), rng.uniform(-0.5, 0.5, n)
    rate, velocity = rng.normal(0.0, 0.2, (n, 3)), rng.normal(0.0, 5.0, (n, 3))
    C_cam_body = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
    found = all_columns(q, height, share, rate, velocity, C_cam_body, lens)

    def seen(points: FloatArray) -> FloatArray:
        return np.column_stack([points[:, 1:] / points[:, :1], -np.log(points[:, 0])])

    def slope(move: FloatArray) -> FloatArray:
        return np.asarray((seen(q + h * move) - seen(q - h * move)) / (2.0 * h))

    for k, axis in enumerate(np.eye(3)):
        # a camera that turns or moves sees all turn or move the other way
        np.testing.assert_allclose(found[:, :, TURN + k], slope(-np.cross(axis, q)), atol=1e-7)
        np.testing.assert_allclose(
            found[:, :, LEVER_ARM + k], slope(np.tile(-C_cam_body @ axis, (n, 1))), atol=1e-7
        )
    later = slope(-np.cross(rate, q) - velocity)
    np.testing.assert_allclose(found[:, :, TIME], later, atol=1e-7)
    np.testing.assert_allclose(found[:, :, SHUTTER], later * share[:, None], atol=1e-7)
    # a picture by another focal length or lens, read as if it were by the stated one
    way = seen(q)[:, :2]
    half = np.column_stack([np.zeros(n), 0.5 * height])

    def read(focal: float, other: FloatArray) -> FloatArray:
        middle, low, high = (
            undistort(lens, focal * distort(other, way + part * half), 1e-9)
            for part in (0.0, 1.0, -1.0)
        )
        return np.column_stack([middle, np.log(low[:, 1] - high[:, 1])])

    for k in range(3):
        ends = []
        for sign in (h, -h):
            other = lens.copy()
            if k:
                other[k - 1] += sign
            ends.append(read(1.0 + (sign if k == 0 else 0.0), other))
        numeric = (ends[0] - ends[1]) / (2.0 * h)
        np.testing.assert_allclose(found[:, :, FOCAL + k], numeric, atol=1e-6)


def test_a_matrix_follows_every_angle_that_changes() -> None:
    """One room for all nodes of a run: angles change one at a time, others stay zero or alike."""
    codes = np.array([[k, TERM_TURN, k, SIGNAL_ONE] for k in range(3)])
    room, now = new_room(), np.array([1.0, 0.0, 0.0, 0.0])
    for angles in (
        (0, 0.2, 0),
        (0, 0, 0),
        (0.2, 0, 0),
        (0.2, 0, 0.2),
        (0.2, 0.1, 0.2),
        (0, 0, 0.3),
    ):
        sum_terms(codes, np.ones(3), now, np.array(angles, float), room)
        matrix = Rotation.from_euler("ZYX", angles[::-1]).as_matrix()
        np.testing.assert_allclose(room[MATRIX : MATRIX + 3], matrix, atol=1e-15)
        for k, axis in enumerate(room[AXES : AXES + 3]):
            moved = Rotation.from_euler(
                "ZYX", (np.array(angles) + 1e-6 * (np.arange(3) == k))[::-1]
            )
            turned = Rotation.from_rotvec(1e-6 * axis).as_matrix() @ matrix
            np.testing.assert_allclose(turned, moved.as_matrix(), atol=1e-11)


def test_the_noise_of_a_velocity_has_no_say_in_the_direction_that_it_is_asked_along() -> None:
    rng, t = np.random.default_rng(23), 0.1 * np.arange(20_000)
    noise = np.column_stack([rng.normal(0.0, 0.3, (len(t), 2)), np.zeros(len(t))])
    direction = travel_of_fixes(t, t, np.array([2.0, 1.0, 0.0]) + noise)
    np.testing.assert_allclose(direction.mean(axis=1), [0.89, 0.45], atol=0.02)
    # else 0.04 m/s, half of the square of the noise over the speed and more
    along = np.sum(noise[:, :2] * direction.T, axis=1)
    assert abs(along.mean()) < 3.0 * along.std() / np.sqrt(len(t))
