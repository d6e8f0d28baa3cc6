"""One sign's estimate against a plain least-squares solver, and what passes of it make together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import boxes, camera, drive_path, roadside
from scipy.optimize import least_squares

from automap.geolocation.landmark import (
    Landmark,
    SizePrior,
    distances_to,
    elapsed_s,
    fit_landmark,
    position_jacobian,
    view_sd,
)
from automap.geolocation.landmark_kernels import N_COMMON, Boxes, solve_landmark
from automap.geolocation.limits import FACE_SD_M, LASTING_ERROR
from automap.geolocation.pass_errors import equations
from automap.geolocation.sightings import Sighting, make_sighting
from automap.geolocation.trajectory_adjustment import place_signs
from automap.geolocation.views import MeasurementNoise, Views, build_views
from automap.mapping.limits import PATH_CORRELATION_S
from automap.records import FloatArray
from automap.robust import BY_CAUCHY, BY_HUBER

PRIOR = SizePrior(0.6, 0.3)
COMMON = (
    "roll", "pitch", "yaw", "time", "focal", "lever_x", "lever_y", "lever_z", "margin", "k1",
    "velocity_x", "velocity_y", "velocity_z",
)  # fmt: skip


@pytest.fixture(scope="module")
def views() -> Views:
    """One sign on a bend; the trajectory's velocity is sure, so that boxes alone have errors."""
    path = drive_path(20.0)
    scene = roadside(path, every_s=40.0)
    found, _ = boxes(path, scene, camera(), np.random.default_rng(0))
    seen = build_views(path, [found], {"front": camera()}, MeasurementNoise())
    return replace(seen, speed_sd=np.zeros(len(seen)))


def expected(views: Views, position: FloatArray, log_size: float) -> FloatArray:
    """Right / forward, down / forward and logarithm of the apparent height [n, 3]."""
    q = np.einsum("nij,nj->ni", views.C_cam_ref, position - views.centre)
    return np.column_stack([q[:, 1] / q[:, 0], q[:, 2] / q[:, 0], log_size - np.log(q[:, 0])])


def by_expected_heights(views: Views, landmark: Landmark) -> FloatArray:
    """Sigmas [n, 3] of the views of a landmark, those of heights by the heights expected."""
    height = expected(views, landmark.position, float(landmark.parameters[3]))[:, 2]
    sd = view_sd(views, landmark.rows)
    sd[:, 2] *= np.exp(views.measured[:, 2] - height)
    return sd


def test_place_size_and_covariance_are_those_of_plain_least_squares(views: Views) -> None:
    rows = np.arange(len(views))
    landmark = fit_landmark(views, rows, PRIOR, robust=False)
    sd = by_expected_heights(views, landmark)

    def residuals(x: FloatArray) -> FloatArray:
        own = (x[3] - np.log(PRIOR.size_m)) / PRIOR.log_sd
        return np.append((views.measured - expected(views, x[:3], x[3])) / sd, own)

    start = np.append(landmark.position + np.array([1.0, -1.0, 0.5]), 0.0)
    found = least_squares(residuals, start, x_scale=[1.0, 1.0, 1.0, 0.1], xtol=1e-14, ftol=1e-14)
    assert landmark.position == pytest.approx(found.x[:3], abs=1e-4)
    assert np.log(landmark.size_m) == pytest.approx(found.x[3], abs=1e-4)
    square = float(np.sum(found.fun**2))
    assert landmark.chi2 == pytest.approx(square, rel=1e-6)
    assert landmark.cost == pytest.approx(square, rel=1e-6)
    assert landmark.dof == 3 * len(rows) - 3
    cov = np.linalg.inv(found.jac.T @ found.jac) * max(1.0, square / landmark.dof)
    J = position_jacobian(views, landmark)
    size = np.sqrt(np.diag(cov)[:3])
    miss = (J @ landmark.covariance @ J.T - cov[:3, :3]) / np.outer(size, size)
    assert np.abs(miss).max() < 1e-3
    assert np.sqrt(landmark.covariance[3, 3]) == pytest.approx(np.sqrt(cov[3, 3]), rel=1e-3)
    assert abs(cov[0, 1]) > 0.3 * size[0] * size[1], "a covariance without cross terms tells little"


def test_an_unsure_velocity_widens_the_views_that_are_far_from_the_anchors() -> None:
    """Cost and covariance at the solution, with the drift of the cameras among the variances of
    the directions: its metres over the distance, not of the heights."""
    path = drive_path(20.0)
    found, _ = boxes(path, roadside(path, every_s=40.0), camera(), np.random.default_rng(0))
    views = build_views(path, [found], {"front": camera()}, MeasurementNoise())
    views = replace(views, speed_sd=np.full(len(views), 0.5))
    rows = np.arange(len(views))
    landmark = fit_landmark(views, rows, PRIOR, robust=False)
    log_size = float(landmark.parameters[3])
    forward = np.exp(log_size - expected(views, landmark.position, log_size)[:, 2])
    late = np.abs(views.t_ns - views.t_ns[landmark.anchor]) * 1e-9
    variance = by_expected_heights(views, landmark) ** 2
    variance[:, :2] += ((0.5 * late / forward) ** 2)[:, None]
    assert variance[0, 0] > 2.0 * view_sd(views, rows)[0, 0] ** 2
    x = np.append(landmark.position, log_size)
    miss = views.measured - expected(views, x[:3], x[3])
    own = (log_size - np.log(PRIOR.size_m)) / PRIOR.log_sd
    square = float(np.sum(miss**2 / variance)) + own**2
    assert landmark.cost == pytest.approx(square, rel=1e-6)
    assert landmark.chi2 == pytest.approx(square, rel=1e-6)
    assert landmark.residual == pytest.approx(miss / np.sqrt(variance), rel=1e-6)
    J = np.empty((miss.size, 4))
    for j in range(4):
        step = 1e-5 * np.eye(4)[j]
        up, down = (expected(views, end[:3], end[3]) for end in (x + step, x - step))
        J[:, j] = (up - down).ravel() / 2e-5
    information = J.T @ (J / variance.ravel()[:, None])
    information[3, 3] += 1.0 / PRIOR.log_sd**2
    gradient = J.T @ (miss / variance).ravel()
    gradient[3] -= own / PRIOR.log_sd
    cov = np.linalg.inv(information)
    # the weights move with the place, so that the cost is least a little beside this
    assert np.sqrt(gradient @ cov @ gradient) < 0.005
    to_place = position_jacobian(views, landmark)
    size = np.sqrt(np.diag(cov)[:3])
    scale = max(1.0, square / landmark.dof)
    got = to_place @ landmark.covariance @ to_place.T / scale
    assert np.abs((got - cov[:3, :3]) / np.outer(size, size)).max() < 1e-3


def moved(views: Views, name: str, step: float) -> Views:
    """The views as they are with something common to them taken to be off by ``step``."""
    part, _, axis = name.partition("_")
    direction = np.zeros(3)
    if axis:
        direction["xyz".index(axis)] = step
    C_ref_body = np.swapaxes(views.C_cam_ref, 1, 2) @ views.C_cam_body
    if part == "lever":
        return replace(views, centre=views.centre + C_ref_body @ direction)
    if part == "velocity":
        anchor = int(np.argmax(views.measured[:, 2]))
        seconds = elapsed_s(views, np.arange(len(views)), anchor)
        return replace(views, centre=views.centre + seconds[:, None] * (C_ref_body @ direction))
    measured = views.measured.copy()
    if name == "focal":
        measured[:, :2] *= np.exp(-step)
        measured[:, 2] -= step
    else:
        assert name == "margin"
        measured[:, 2] -= step * np.exp(-measured[:, 2])
    return replace(views, measured=measured)


BY_CAMERA = ("roll", "pitch", "yaw", "time", "k1")


@pytest.mark.parametrize("name", [n for n in COMMON if n not in BY_CAMERA])
def test_what_is_common_to_the_views_moves_the_sign_as_its_derivative_says(
    views: Views, name: str
) -> None:
    """Turn, time and lens have a test of their own, by another camera."""
    rows = np.arange(len(views))
    plain = fit_landmark(views, rows, PRIOR, robust=False)
    # boxes without noise: then the derivative of first order is all
    exact = replace(views, measured=expected(views, plain.position, float(plain.parameters[3])))
    prior = replace(PRIOR, size_m=plain.size_m)
    landmark = fit_landmark(exact, rows, prior, robust=False)
    step = 1e-4
    ends = []
    for sign in (1.0, -1.0):
        fit = fit_landmark(moved(exact, name, sign * step), rows, prior, robust=False)
        ends.append(np.append(fit.position, np.log(fit.size_m)))
    numeric = (ends[0] - ends[1]) / (2.0 * step)
    place_and_size = np.vstack([position_jacobian(exact, landmark), [0.0, 0.0, 0.0, 1.0]])
    N, A, *_ = equations(exact, landmark, landmark.parameters, np.zeros(N_COMMON), prior)
    effect = -place_and_size @ np.linalg.solve(N, A)[:, COMMON.index(name)]
    assert np.abs(effect - numeric).max() < 0.01 * np.abs(numeric).max()


def test_distances_of_boxes_are_those_of_the_full_covariance(views: Views) -> None:
    """From signs fitted to other views, by their expectation's numeric derivative."""
    n = len(views)
    marks = [fit_landmark(views, np.arange(first, n // 2 + first), PRIOR) for first in (0, 2)]
    row, slack = n - 1, 0.004
    frame = np.array([row])
    found = distances_to(views, marks, frame, slack)
    one = replace(
        views,
        **{name: getattr(views, name)[frame] for name in ("C_cam_ref", "centre", "measured", "sd")},
    )

    def seen(mark: Landmark, parameters: FloatArray) -> FloatArray:
        direction = np.exp(parameters[2]) * np.array([1.0, *parameters[:2]])
        anchor = mark.anchor
        position = views.centre[anchor] + views.C_cam_ref[anchor].T @ direction
        return expected(one, position, float(parameters[3]))[0]

    for k, mark in enumerate(marks):
        J = np.empty((3, 4))
        for j in range(4):
            step = np.zeros(4)
            step[j] = 1e-5
            J[:, j] = (
                seen(mark, mark.parameters + step) - seen(mark, mark.parameters - step)
            ) / 2e-5
        S = J @ mark.covariance @ J.T + np.diag(one.sd[0] ** 2 + [slack**2, slack**2, 0.0])
        miss = one.measured[0] - seen(mark, mark.parameters)
        assert found[0, k] == pytest.approx(float(miss @ np.linalg.solve(S, miss)), rel=1e-5)


def tilted(rng: np.random.Generator, size: float) -> FloatArray:
    """A covariance [3, 3] with all its cross terms."""
    root = size * rng.standard_normal((3, 3))
    return root @ root.T


PATH_SD = np.array([0.7, 0.5, 0.9])


@pytest.fixture(scope="module")
def passes(views: Views) -> list[Sighting]:
    """Three sightings of one sign with errors of every kind, the camera's and its size's the same
    in all."""
    rng = np.random.default_rng(6)
    base = make_sighting(views, fit_landmark(views, np.arange(len(views)), PRIOR), [np.eye(10)])
    camera_cov, effect = 0.01 * np.cov(rng.standard_normal((10, 40))), rng.normal(size=(3, 10))
    size = 0.2 * rng.standard_normal(3)
    return [
        replace(
            base,
            position=rng.normal(0.0, 0.3, 3),
            own_cov=tilted(rng, 0.3) + np.outer(size, size),
            pass_cov=tilted(rng, 0.2),
            camera_effect=effect,
            camera_cov=camera_cov,
            size_effect=size,
            path_sd=PATH_SD,
            time_s=1000.0 + time_s,
        )
        for time_s in (10.0, 40.0, 110.0)
    ]


def joint(passes: list[Sighting]) -> FloatArray:
    """Covariance [3 n, 3 n] of the positions, all of a sign at the origin."""
    time = np.array([s.time_s for s in passes])
    keep = np.exp(-np.abs(time[:, None] - time) / PATH_CORRELATION_S)
    keep = LASTING_ERROR + (1.0 - LASTING_ERROR) * keep
    one = passes[0]
    common = one.camera_effect @ one.camera_cov @ one.camera_effect.T
    common = common + np.outer(one.size_effect, one.size_effect)
    total = np.kron(keep, np.diag(PATH_SD**2)) + np.kron(np.ones(keep.shape), common)
    for k, s in enumerate(passes):
        own = s.own_cov + s.pass_cov - np.outer(s.size_effect, s.size_effect)
        total[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += own + FACE_SD_M**2 * np.eye(3)
    return total


@pytest.mark.parametrize("adjust", [False, True])
def test_the_place_of_passes_is_the_best_by_all_their_errors(
    passes: list[Sighting], adjust: bool
) -> None:
    path = replace(drive_path(130.0), sd_pos_ned=np.tile(PATH_SD, (13000, 1)))
    placed, adjustment = place_signs(path, passes, [[0, 1, 2]], {}, adjust)
    total, H = joint(passes), np.tile(np.eye(3), (3, 1))
    covariance = np.linalg.inv(H.T @ np.linalg.solve(total, H))
    place = np.concatenate([s.position for s in passes])
    mean = covariance @ H.T @ np.linalg.solve(total, place)
    assert placed.place[0] == pytest.approx(mean, abs=1e-6)
    assert placed.covariance[0] == pytest.approx(covariance, abs=1e-6)
    assert placed.by_size[0] == pytest.approx(passes[0].size_effect, abs=1e-9)
    assert (adjustment is not None) is adjust


def test_cameras_do_not_share_their_errors(passes: list[Sighting]) -> None:
    """What one camera's turn moves, another's does not."""
    path = drive_path(130.0)
    two = [replace(s, camera=k) for k, s in enumerate(passes)]
    one, other = (place_signs(path, p, [[0, 1, 2]], {})[0].covariance[0] for p in (passes, two))
    assert np.trace(other) < np.trace(one)


def test_a_surveyed_sign_stands_where_the_survey_says(passes: list[Sighting]) -> None:
    """Camera and size err by decimetres; the survey does not."""
    surveyed = np.array([0.3, -0.2, 0.1]), np.diag([0.05**2, 0.05**2, 1e6])
    placed, adjustment = place_signs(drive_path(130.0), passes, [[0, 1, 2]], {0: surveyed})
    assert adjustment is not None
    assert placed.place[0, :2] == pytest.approx(surveyed[0][:2], abs=0.05)
    assert np.sqrt(np.diag(placed.covariance[0]))[:2].max() < 0.06


def test_a_sign_of_one_pass_is_as_that_says(passes: list[Sighting]) -> None:
    placed, adjustment = place_signs(drive_path(130.0), passes, [[0], [1], [2]], {})
    assert adjustment is None
    for k, s in enumerate(passes):
        np.testing.assert_array_equal(placed.of(k)[0], s.position)
        np.testing.assert_array_equal(placed.of(k)[1], s.covariance)


@pytest.mark.parametrize("height_sd", [1e3, 1e160, np.inf])
def test_boxes_of_one_place_that_tell_no_height_are_no_error(height_sd: float) -> None:
    """They tell a direction; the search for a distance ends where it began, or near."""
    start, n = np.array([0.11, 0.06, 3.0, -0.5]), 2
    seen = Boxes(
        np.tile(np.eye(3), (n, 1, 1)),
        np.zeros((n, 3)),
        np.tile([0.1, 0.05, -3.0], (n, 1)),
        np.tile([2e-3, 2e-3, height_sd], (n, 1)),
        np.zeros(n),
        -0.5,
        0.3,
    )
    found, cost = solve_landmark(start, seen, BY_HUBER, BY_CAUCHY)
    assert np.isfinite(found).all()
    worse = seen._replace(measured=seen.measured + 1.0)
    assert cost <= solve_landmark(start, worse, BY_HUBER, BY_CAUCHY)[1]
