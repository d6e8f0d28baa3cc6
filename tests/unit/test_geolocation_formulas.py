"""Formulas of the geolocation against geometry, numeric derivatives and SciPy's minimum."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geolocation_scene import ORIGIN, camera, drive_path
from scipy.optimize import minimize

from automap.earth import from_local_ned, local_ned
from automap.frames import rpy_to_matrix
from automap.gates import gate
from automap.geolocation import control, limits, tracking
from automap.geolocation.bearing_rays import (
    BearingRules,
    Rays,
    costs,
    fit_point,
    in_plane,
    normal_equations,
)
from automap.geolocation.camera_hypotheses import Hypothesis, _mountings
from automap.geolocation.due_frames import Searched, _aspect, apparent_heights
from automap.geolocation.epipolar import PairGeometry
from automap.geolocation.existence import expected_log_odds
from automap.geolocation.path_relation import make_path, roads_at, side_of_path
from automap.geolocation.trajectory_adjustment import Placed
from automap.mapping.looks import probability
from automap.records import Bearings, FloatArray, SignPoints, Trajectory


def rays_to(point: FloatArray, rng: np.random.Generator, n: int = 8) -> tuple[Rays, FloatArray]:
    """Cameras round a point that see it with errors, some with a depth; the errors in sigmas."""
    turn = rng.uniform(0.0, 2.0 * np.pi, n)
    distance = rng.uniform(6.0, 25.0, n)
    centre = point - distance[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    sd = rng.uniform(0.01, 0.05, n)
    error = rng.normal(size=(n, 2))
    log_depth = np.log(distance) + 0.3 * error[:, 1]
    log_depth[::3] = np.nan
    bearing = (turn + sd * error[:, 0]) % (2.0 * np.pi)
    return Rays(centre, bearing, sd, log_depth, np.arange(n)), error


RULES = BearingRules(position_sd_m=0.0)
"""With cameras whose places are known the weights do not change with the point."""


def test_a_sightings_cost_is_its_squared_errors_in_sigmas() -> None:
    rng = np.random.default_rng(1)
    point = np.array([30.0, -12.0])
    rays, error = rays_to(point, rng)
    found = costs(rays, np.arange(8), point[None], RULES)[:, 0]
    square = error**2
    square[::3, 1] = 0.0
    assert found == pytest.approx(square.sum(axis=1))
    far = point + np.array([RULES.max_range_m + 30.0, 0.0])
    assert np.isinf(costs(rays, np.arange(8), far[None], RULES)).all()
    # what lies behind a camera it does not see
    behind = 2.0 * rays.centre[:1] - point
    assert np.isinf(costs(rays, np.arange(1), behind, RULES)).all()
    # a camera that is a metre off: one more radian-metre over the distance, for either part
    unsure = BearingRules(position_sd_m=1.0)
    near = np.linalg.norm(point - rays.centre, axis=1) ** -2.0
    wanted = square[:, 0] * rays.sd**2 / (rays.sd**2 + near)
    wanted += square[:, 1] * 0.3**2 / (0.3**2 + near)
    assert costs(rays, np.arange(8), point[None], unsure)[:, 0] == pytest.approx(wanted)


def test_normal_equations_are_the_derivatives_of_the_cost() -> None:
    rng = np.random.default_rng(2)
    point = np.array([30.0, -12.0])
    rays, _ = rays_to(point, rng)
    rows, h = np.arange(8), 1e-4

    def half_cost(x: FloatArray, of: Rays) -> float:
        return 0.5 * float(costs(of, rows, x[None], RULES).sum())

    away = point + np.array([0.7, -0.4])
    _, g = normal_equations(rays, rows, away, RULES)
    slope = [
        (half_cost(away + e, rays) - half_cost(away - e, rays)) / (2 * h) for e in h * np.eye(2)
    ]
    assert -g == pytest.approx(np.array(slope), rel=1e-5)
    # without errors Gauss and Newton have the same second derivatives
    offset = point - rays.centre
    exact = Rays(
        rays.centre,
        np.arctan2(offset[:, 1], offset[:, 0]),
        rays.sd,
        np.where(np.isfinite(rays.log_depth), np.log(np.linalg.norm(offset, axis=1)), np.nan),
        rays.camera,
    )
    N, _ = normal_equations(exact, rows, point, RULES)
    a, b = h * np.eye(2)
    second = np.array(
        [
            [
                half_cost(point + p + q, exact)
                - half_cost(point + p - q, exact)
                - half_cost(point - p + q, exact)
                + half_cost(point - p - q, exact)
                for q in (a, b)
            ]
            for p in (a, b)
        ]
    ) / (4.0 * h**2)
    np.testing.assert_allclose(N - 1e-6 * np.eye(2), second, rtol=1e-4, atol=1e-4)


def test_the_fitted_point_is_the_least_of_the_cost() -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        point = rng.normal(0.0, 20.0, 2)
        rays, _ = rays_to(point, rng)
        rows = np.arange(8)
        found = fit_point(rays, rows, point + rng.normal(0.0, 2.0, 2), RULES)
        best = minimize(
            lambda x, rays=rays, rows=rows: float(costs(rays, rows, x[None], RULES).sum()),
            point, method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-10},
        )  # fmt: skip
        assert found == pytest.approx(best.x, abs=2e-3)


def test_sightings_of_one_place_are_of_one_camera_and_unknown_errors_are_the_rules() -> None:
    lat = np.array([0.6, 0.6, 0.6 + 1e-5])
    bearings = Bearings(
        lat, np.full(3, 0.2), np.array([0.1, 0.2, 0.3]), np.array([5.0, 0.0, np.nan]),
        np.array(["", "", ""], object), np.array([0.01, np.nan, 0.03]),
    )  # fmt: skip
    rays = in_plane(bearings, BearingRules(bearing_sd_rad=0.07), (0.6, 0.2, 0.0))
    assert rays.camera[0] == rays.camera[1] != rays.camera[2]
    assert rays.sd.tolist() == [0.01, 0.07, 0.03]
    assert np.exp(rays.log_depth[0]) == pytest.approx(5.0)
    assert np.isnan(rays.log_depth[1:]).all()
    assert rays.centre[2] == pytest.approx([1e-5 * 6.37e6, 0.0], rel=1e-2, abs=1e-6)


@pytest.mark.parametrize("turn_rate", [0.08, -0.08])
@pytest.mark.parametrize("right_m", [6.0, -6.0])
def test_a_signs_offset_from_a_bend_is_the_difference_of_two_radii(
    turn_rate: float, right_m: float
) -> None:
    """A circle of 150 m, twice round: what counts is the pass in which the sign was seen."""
    trajectory = drive_path(160.0, 12.0, turn_rate)
    path = make_path(trajectory, ORIGIN)
    at = 4000  # row, after 40 s
    course = 0.7 + turn_rate * 40.0
    side = np.array([-np.sin(course), np.cos(course), 0.0])
    here = local_ned(*(v[at : at + 1] for v in (trajectory.lat_rad, trajectory.lon_rad)),
                     trajectory.height_m[at : at + 1], ORIGIN)[0]  # fmt: skip
    sign = here + right_m * side - np.array([0.0, 0.0, 2.5])
    t = trajectory.t_ns[at]
    first, last = int(t - 4e9), int(t - 1e9)
    passed, seen = roads_at(path, sign, first, last)
    assert passed[4] == pytest.approx(2.5, abs=0.01)
    for found, wanted in ((passed, course), (seen, course - turn_rate * 1.0)):
        assert np.cos(found[0] - wanted) > np.cos(0.01)
        assert found[1:3] == pytest.approx([-np.sin(found[0]), np.cos(found[0])])
    assert passed[3] == pytest.approx(right_m, abs=0.05)
    # seen from half a round later on, the path beside it is another
    elsewhere = roads_at(path, sign, int(t + 30e9), int(t + 32e9))[0, 3]
    assert abs(elsewhere) > 30.0


def test_the_course_of_what_stands_is_where_it_points() -> None:
    moving = drive_path(4.0, 12.0, 0.0)
    standing = Trajectory(
        **vars(moving) | {"vel_ned": np.full((len(moving), 3), 0.2), "rpy": moving.rpy + 0.4}
    )
    assert make_path(moving, ORIGIN).course == pytest.approx(0.7)
    assert make_path(standing, ORIGIN).course == pytest.approx(1.1)
    path = make_path(moving, ORIGIN)
    # 20 rows a second of 100
    assert np.diff(path.t_ns) == pytest.approx(5e7)
    assert np.diff(path.position[:, :2], axis=0) == pytest.approx(
        np.tile(0.6 * np.array([np.cos(0.7), np.sin(0.7)]), (len(path.t_ns) - 1, 1)), abs=1e-3
    )
    # an unknown height is the origin's
    flat = Trajectory(**vars(moving) | {"height_m": np.full(len(moving), np.nan)})
    assert make_path(flat, ORIGIN).position[:, 2] == pytest.approx(0.0, abs=1e-3)


def test_sides_of_the_path() -> None:
    low, high = limits.OVERHEAD_HEIGHT_M - 0.1, limits.OVERHEAD_HEIGHT_M + 0.1
    near, wide = limits.OVERHEAD_LATERAL_M - 0.1, limits.OVERHEAD_LATERAL_M + 0.1
    assert [side_of_path(x, low) for x in (near, -near)] == ["right", "left"]
    assert [side_of_path(x, high) for x in (near, -near)] == ["overhead", "overhead"]
    assert [side_of_path(x, high) for x in (wide, -wide)] == ["right", "left"]


def test_odds_and_probabilities_are_each_others_inverse() -> None:
    p = np.array([0.001, 0.3, 0.5, 0.97])
    assert probability(np.log(p / (1.0 - p))) == pytest.approx(p)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_the_share_of_signs_among_single_boxes_is_that_which_made_them(share: float) -> None:
    """Things of which that share are signs, each with evidence that is as told: a normal one of
    mean +- d^2 / 2 and sd d, in nats."""
    rng = np.random.default_rng(4)
    is_sign = rng.random(4000) < share
    d = 2.5
    evidence = np.where(is_sign, 0.5, -0.5) * d**2 + d * rng.normal(size=4000)
    found = probability(np.array([expected_log_odds(evidence, np.ones(4000), (2.0, 2.0))]))[0]
    assert found == pytest.approx(share, abs=0.03)
    # nothing told leaves one half, and a few things move it little
    few, many = (expected_log_odds(np.full(n, -30.0), np.ones(n), (2.0, 2.0)) for n in (1, 50))
    assert expected_log_odds(np.zeros(0), np.zeros(0), (2.0, 2.0)) == pytest.approx(0.0)
    assert few > many
    # as many as are imagined, and no more than these where nothing counts
    assert many == pytest.approx(np.log(2.0 / 52.0))
    unlikely = np.full(50, -30.0)
    assert expected_log_odds(unlikely, np.zeros(50), (1.0, 5.0)) == pytest.approx(-np.log(5.0))


def test_a_face_is_looked_at_as_before_within_the_angle_it_was_seen_under() -> None:
    sign = np.array([0.0, 0.0, -2.0])
    seen = np.array([[-20.0, -4.0, 0.0], [-20.0, 4.0, 0.0]])
    widest = np.arctan2(4.0, 20.0) + limits.LIKE_ASPECT_RAD
    angle = np.array([0.0, widest - 0.01, -widest + 0.01, widest + 0.01, -widest - 0.01, np.pi])
    centre = -12.0 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(6)])
    assert _aspect(sign, seen, centre).tolist() == [True, True, True, False, False, False]


def test_a_surveyed_sign_is_the_one_within_both_sigmas() -> None:
    """Along a slanting covariance twice as far as across it; another class makes no difference to
    who is near enough, but to whom a place belongs."""
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    covariance = np.eye(3)
    covariance[:2, :2] = turn @ np.diag([3.75, 0.75]) @ turn.T
    sd = 0.5
    reach = np.sqrt(gate(limits.MISSED_PROBABILITY, 2))
    place = np.array([40.0, -25.0, 0.0])
    placed = Placed(place[None], covariance[None], np.zeros((1, 3)))
    for sigma, direction in ((2.0, turn[:, 0]), (1.0, turn[:, 1])):
        for factor, name in ((0.98, "a"), (0.98, "b"), (1.02, "a")):
            at = place[:2] + factor * reach * sigma * direction
            lat, lon, _ = from_local_ned(np.array([*at, 0.0]), ORIGIN)
            surveyed = SignPoints(
                *(np.array([float(v)]) for v in (lat, lon)),
                np.array([name], object),
                np.full((1, 2, 2), np.nan),
                np.array([sd]),
            )
            found = control.match_control(surveyed, {0: "a"}, placed, ORIGIN)
            assert bool(found) == (factor < 1.0)
            if found:
                assert found[0][0][:2] == pytest.approx(at, abs=1e-3)
                assert np.diag(found[0][1])[:2] == pytest.approx([sd**2] * 2)


@pytest.mark.parametrize(
    ("beside_m", "names", "also", "matched"),
    [
        (1.5, ("", "a", "b"), False, []),  # as near, and nothing tells which
        (3.0, ("", "a", "b"), False, []),
        (3.0, ("a", "a", "b"), False, [0]),  # the class does
        (1.5, ("", "a", "b"), True, [0, 1]),  # the neighbour was surveyed too
        (0.2, ("", "a", "b"), False, [1]),  # on the same post: the place is the same
        (8.0, ("", "a", "b"), False, [0]),
    ],
)
def test_a_surveyed_sign_that_may_be_a_neighbour_does_not_count(
    beside_m: float,
    names: tuple[str, str, str],
    also: bool,
    matched: list[int],
) -> None:
    """The path is off by 0.9 m towards a neighbour, which looks the nearer by it."""
    place = np.array([[0.0, 0.0, 0.0], [0.0, -beside_m, 0.0]])
    placed = Placed(place, np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)))
    east = [-0.9, -beside_m - 0.9][: 1 + also]
    lat, lon, _ = from_local_ned(np.array([[0.0, e, 0.0] for e in east]), ORIGIN)
    classes, none = (
        np.array([names[0], ""][: len(east)], object),
        np.full((len(east), 2, 2), np.nan),
    )
    surveyed = SignPoints(lat, lon, classes, none, np.full(len(east), 0.1))
    found = control.match_control(surveyed, dict(enumerate(names[1:])), placed, ORIGIN)
    assert sorted(found) == matched


def test_cameras_that_are_turned_are_turned_by_right_angles_about_an_axis_of_theirs() -> None:
    stated = camera()
    mount = rpy_to_matrix(stated.mount_rpy)
    found: Any = None
    for one in _mountings(Hypothesis("", found, stated)):
        new = rpy_to_matrix(one.camera.mount_rpy)
        turn = mount.T @ new if "rolled" in one.what else new @ mount.T
        about = 0 if "rolled" in one.what else 2
        assert turn[about] == pytest.approx(np.eye(3)[about], abs=1e-12)
        cosine = -1.0 if "other way" in one.what else 0.0
        assert turn.trace() == pytest.approx(1.0 + 2.0 * cosine, abs=1e-12)


def test_a_sign_is_in_view_where_a_margin_of_its_height_is_left_on_all_sides() -> None:
    path = drive_path(4.0, turn_rate=0.0)
    view = camera(mount_rpy=np.zeros(3), lever_arm_m=np.zeros(3))
    row, size = 100, 0.9
    here = np.asarray(
        local_ned(path.lat_rad[row], path.lon_rad[row], path.height_m[row], ORIGIN)
    ).reshape(3)
    away, turn = 20.0, rpy_to_matrix(path.rpy[row])
    height = 1000.0 * size / away
    margin = limits.WHOLLY_IN_VIEW * height
    whole = np.array([[0.0, 0.0, 1279.0, 719.0]])
    for axis, last in ((0, 1279.0), (1, 719.0)):
        for edge, inwards in ((0.0, 1.0), (last, -1.0)):
            for beyond in (-0.3, 0.3):
                pixel = np.array([640.0, 360.0])
                pixel[axis] = edge + inwards * (margin - beyond)
                ray = np.array([1.0, *((pixel - [640.0, 360.0]) / 1000.0)])
                place = here + turn @ (away * ray)
                t_ns = path.t_ns[[row]]
                searched = Searched(view, np.array([row]), t_ns, whole)
                views: Any = SimpleNamespace(centre=here[None], origin=ORIGIN)
                mark: Any = SimpleNamespace(rows=np.array([0]), position=place, size_m=size)
                found = apparent_heights(views, mark, path, searched, slice(None))
                assert found == pytest.approx([0.0 if beyond > 0.0 else height], rel=1e-6)


@pytest.mark.parametrize("rate", [-0.01, 0.5])
def test_stamps_that_run_slower_gain_a_part_of_the_time_since_the_first(rate: float) -> None:
    pairs = np.array([[0, 1], [2, 3]])
    t_ns = np.array([5, 9, 11, 14]) * 10**9
    path = drive_path(1.0)
    late = PairGeometry(path, camera(), ORIGIN, np.eye(4, 3), t_ns, pairs).paced(rate)
    assert late.t_ns.tolist() == [round(1e9 * (t + rate * (t - 5))) for t in (5, 9, 11, 14)]


@pytest.mark.parametrize("number", [-1, 0, 7])
@pytest.mark.parametrize("known", [set(), {0}, {7, 3}])
def test_a_box_of_a_tracks_number_is_nearer_and_one_of_another_farther(
    number: int, known: set[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A number below zero is none, of a box or of a track."""
    monkeypatch.setattr(tracking, "distances_to", lambda *_: np.array([[1.5]]))
    views: Any = SimpleNamespace(class_name=np.array(["a"], object), track=np.array([number]))
    track = tracking._Track([0], Any, 0, {"a": 3.0, "b": 1.0}, known)  # type: ignore[arg-type]
    cost = float(tracking._link_costs(views, [track], np.array([0]))[0, 0])
    wanted = 1.5 + 0.25 * limits.LINK_OTHER
    if number >= 0 and known:
        wanted += -limits.LINK_OTHER if number in known else limits.LINK_OTHER
    assert cost == pytest.approx(wanted)
