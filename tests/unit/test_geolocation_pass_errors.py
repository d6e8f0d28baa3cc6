"""Errors that the views of a sign share in one pass, and the scatter of boxes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import boxes, camera, drive_path, roadside

from automap.geolocation import limits
from automap.geolocation.boresight import evidence_of
from automap.geolocation.box_noise import scatter
from automap.geolocation.landmark import Landmark, SizePrior, fit_landmark
from automap.geolocation.landmark_kernels import N_COMMON, VELOCITY
from automap.geolocation.pass_errors import equations, pass_sd, solve_with_pass_errors
from automap.geolocation.sightings import make_sighting
from automap.geolocation.views import CameraCorrection, MeasurementNoise, Views, build_views
from automap.records import Detections

PRIOR = SizePrior()


@pytest.fixture(scope="module")
def approach() -> tuple[Views, Landmark, Detections]:
    """A sign approached on a bend, exact boxes."""
    path = drive_path(30.0)
    found, owner = boxes(
        path, roadside(path, every_s=4.0), camera(), np.random.default_rng(0), noise_px=0.0
    )
    rows = np.flatnonzero(owner == np.bincount(owner).argmax())
    fields = ("frame", "t_ns", "class_name", "box", "score", "track")
    one = Detections(*(getattr(found, name)[rows] for name in fields))
    views = build_views(path, [one], {"front": camera()}, MeasurementNoise())
    return views, fit_landmark(views, np.arange(len(views)), PRIOR), one


def with_velocity_error(views: Views, landmark: Landmark, error: np.ndarray) -> Views:
    """The views of a trajectory whose velocity was off by ``error`` in vehicle axes."""
    from automap.geolocation.landmark import elapsed_s

    seconds = elapsed_s(views, landmark.rows, landmark.anchor)
    C_ref_body = np.swapaxes(views.C_cam_ref, 1, 2) @ views.C_cam_body
    return replace(views, centre=views.centre - seconds[:, None] * (C_ref_body @ error))


def test_a_velocity_error_has_the_effect_that_its_derivative_says(approach) -> None:
    views, landmark, _ = approach
    for axis in range(3):
        error = np.zeros(3)
        error[axis] = 0.05
        shifted = with_velocity_error(views, landmark, error)
        bias = np.zeros(N_COMMON)
        bias[VELOCITY + axis] = 0.05
        none = np.zeros(N_COMMON)
        rest = equations(views, landmark, landmark.parameters, none, PRIOR)[3]
        effect = equations(shifted, landmark, landmark.parameters, none, PRIOR)[3] - rest
        regarded = equations(shifted, landmark, landmark.parameters, bias, PRIOR)[3] - rest
        assert np.abs(regarded).max() < 0.05 * np.abs(effect).max()


def test_the_margin_of_boxes_has_the_effect_that_its_derivative_says(approach) -> None:
    views, _, found = approach
    margin_px = 2.0
    loose = found.box + np.array([0.0, -0.5, 0.0, 0.5]) * margin_px
    path = drive_path(30.0)
    correction = CameraCorrection(
        np.zeros(3), 0.0, np.eye(10), margin=margin_px / camera().matrix[1, 1]
    )
    again = build_views(
        path,
        [replace(found, box=loose)],
        {"front": camera()},
        MeasurementNoise(),
        {"front": correction},
    )
    np.testing.assert_allclose(again.measured, views.measured, atol=1e-9)


def test_an_error_of_the_pass_is_found_within_its_sigma(approach) -> None:
    views, landmark, _ = approach
    error = np.array([0.0, 0.15, 0.0])
    unsure = replace(views, velocity_sd=np.full_like(views.velocity_sd, 0.15))
    shifted = with_velocity_error(unsure, landmark, error)
    plain = fit_landmark(shifted, landmark.rows, PRIOR)
    settled = solve_with_pass_errors(shifted, plain, PRIOR)
    off = [float(np.linalg.norm(m.position - landmark.position)) for m in (plain, settled)]
    assert off[1] < off[0]
    # where sign and errors of the pass settle, the gradient of both is nothing
    sd = pass_sd(shifted, settled.rows)
    assert settled.pass_bias[VELOCITY + 1] > 0.5 * 0.15
    found = equations(shifted, settled, settled.parameters, settled.pass_bias, PRIOR)[2]
    off = sd**2 * found[:N_COMMON, -1] - settled.pass_bias
    assert (np.abs(off) <= 0.01 * sd).all()
    assert settled.pass_covariance[2, 2] > 0.0
    assert np.linalg.eigvalsh(settled.pass_covariance).min() > -1e-9


def test_what_scatters_more_than_stated_widens_by_the_degrees_of_freedom(approach) -> None:
    """Three measurements a view and the size's prior, less the four that a sign has."""
    views, landmark, _ = approach
    rng = np.random.default_rng(5)
    wild = replace(
        views, measured=views.measured + 4.0 * views.sd * rng.normal(size=(len(views), 3))
    )
    few = landmark.rows[:: max(len(landmark.rows) // 4, 1)][:4]
    settled = solve_with_pass_errors(wild, fit_landmark(wild, few, PRIOR), PRIOR)
    at = settled.parameters, settled.pass_bias
    own, _, _, _, _, chi2, _ = equations(wild, settled, *at, PRIOR)
    assert chi2 > 3 * len(few)
    expected = np.linalg.inv(own) * chi2 / (3 * len(few) - 3)
    np.testing.assert_allclose(settled.covariance, expected, rtol=1e-6)


def test_a_sure_trajectory_leaves_the_sign_alone(approach) -> None:
    views, landmark, _ = approach
    nothing = np.zeros_like(views.velocity_sd)
    sure = replace(views, velocity_sd=nothing, attitude_sd=nothing, margin_sd=np.zeros(len(views)))
    assert pass_sd(sure, landmark.rows)[[0, 1, 2, 8, 9, 10, 11]].sum() == 0.0
    settled = solve_with_pass_errors(sure, landmark, PRIOR)
    np.testing.assert_allclose(settled.position, landmark.position, atol=0.02)


def test_scatter_of_white_and_of_alike_residuals() -> None:
    rng = np.random.default_rng(1)
    white = [2.0 * rng.normal(size=20) for _ in range(200)]
    alone = [np.ones(20)] * 200
    assert scatter(white, alone) == pytest.approx(2.0, rel=0.12)
    alike = []
    for _ in range(200):
        x = rng.normal(size=20)
        for k in range(1, 20):
            x[k] = 0.6 * x[k - 1] + 0.8 * x[k]
        alike.append(x)
    assert scatter(alike, alone) > 1.5
    assert scatter([], []) == 1.0
    few = scatter([0.1 * rng.normal(size=6)], [np.ones(6)])
    assert few > 0.7, "a few boxes do not overrule the settings"


def test_a_car_that_waits_makes_no_boxes_sharper() -> None:
    rng = np.random.default_rng(2)
    crowd = np.append(np.ones(12), np.full(150, 150.0))
    waited = [2.0 * rng.normal(size=162) / np.sqrt(crowd) for _ in range(100)]
    assert scatter(waited, [crowd] * 100, 0.0) == pytest.approx(2.0, rel=0.12)
    # boxes that a tracker holds while it waits are one
    held = [r.copy() for r in waited]
    for values in held:
        values[12:] = values[12]
    assert scatter(held, [crowd] * 100, 0.0) == pytest.approx(2.0, rel=0.2)


def test_noise_of_heights_is_not_taken_for_a_margin() -> None:
    """Boxes without margins, of signs seen from afar only, tell of none."""
    path = drive_path(120.0, turn_rate=0.0)
    far, rng = (40.0, 55.0), np.random.default_rng(5)
    scene = roadside(path, every_s=2.5)
    found, owner = boxes(path, scene, camera(), rng, 0.3, 0.1, range_m=far)
    middle, half = (
        0.5 * (found.box[:, 1] + found.box[:, 3]),
        0.5 * np.ptp(found.box[:, 1::2], axis=1),
    )
    half += rng.normal(0.0, 0.7, len(half))
    box = np.column_stack([found.box[:, 0], middle - half, found.box[:, 2], middle + half])
    views = build_views(path, [replace(found, box=box)], {"front": camera()}, MeasurementNoise())
    size, sd = SizePrior(0.75, 0.05), np.zeros(N_COMMON)
    told = [
        evidence_of(
            views, fit_landmark(views, np.flatnonzero(owner[views.row] == k), size), size, sd
        )
        for k in range(len(scene.size_m))
        if (owner == k).sum() > 9
    ]
    known, pull = sum(own[-1, -1] for own, _ in told), sum(step[-1] for _, step in told)
    # by each box's own height two sigmas and more of a margin that is none
    assert abs(pull / known) < 1.2 / np.sqrt(known)


def test_what_a_sign_is_taken_for_moves_its_place_as_is_told(approach) -> None:
    """A tenth of a sigma of the usual size and of the margin that comes again, each put in."""
    views, landmark, _ = approach
    views = replace(views, margin_sd=4.0 * views.margin_sd)
    rows = landmark.rows[np.exp(views.measured[landmark.rows, 2]) < 0.75 / 25.0]
    assert len(rows) > 4

    def place(seen: Views, size: SizePrior) -> np.ndarray:
        return solve_with_pass_errors(seen, fit_landmark(seen, rows, size), size).position

    usual, tenth = SizePrior(0.75, 0.03), 0.1
    at = place(views, usual)
    larger = place(views, SizePrior(0.75 * np.exp(tenth * 0.03), 0.03))
    margin = tenth * np.sqrt(limits.MARGIN_ALIKE) * views.margin_sd
    taller = views.measured.copy()
    taller[:, 2] = np.log(np.exp(taller[:, 2]) + margin)
    looser = place(replace(views, measured=taller), usual)
    mark = solve_with_pass_errors(views, fit_landmark(views, rows, usual), usual)
    told = make_sighting(views, mark, [np.eye(10)], size=usual).size_effect
    moved = np.hypot(np.linalg.norm(larger - at), np.linalg.norm(looser - at)) / tenth
    assert np.linalg.norm(looser - at) > 0.5 * np.linalg.norm(larger - at)
    assert np.linalg.norm(told) == pytest.approx(moved, rel=0.15)
