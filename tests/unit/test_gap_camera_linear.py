"""The camera's fit made linear: the same equations, in the form of all candidates."""

from __future__ import annotations

import numpy as np
import pytest

from automap.effects import CATALOGUE
from automap.gap.camera.fit import CameraFit, box_noise, fit_camera
from automap.gap.camera.linear import selection_of
from automap.gap.camera.views import keys
from automap.gap.evidence import plain_nats
from automap.gap.selection import Chosen, Selection
from automap.records import FloatArray
from tests.unit.test_gap_camera import PIXEL_SD, boxes_with

TURNED = {"camera_boresight": {"roll": 0.0, "pitch": 0.012, "yaw": -0.02}}


@pytest.fixture(scope="module")
def fit() -> CameraFit:
    boxes = boxes_with(TURNED)
    sd = box_noise(boxes, np.full(2, PIXEL_SD), np.zeros(2))
    return fit_camera(boxes, sd, np.zeros(boxes.n_common))


@pytest.fixture(scope="module")
def selection(fit: CameraFit) -> Selection:
    return selection_of(fit, list(dict(keys())))


def equations(fit: CameraFit) -> tuple[FloatArray, FloatArray]:
    """Information and score of all shared parameters, counted from zero."""
    info = fit.info.sum(axis=0)
    return info, fit.right.sum(axis=0) + info @ fit.common


def test_rows_have_the_equations_of_the_signs(fit: CameraFit, selection: Selection) -> None:
    info, score = equations(fit)
    phi = np.concatenate([r.phi for r in selection.linear.rows])
    w = np.concatenate([r.w for r in selection.linear.rows])
    sds = selection.linear.prior_sd
    scale = np.outer(sds, sds)
    size = np.abs(info * scale).max()
    np.testing.assert_allclose(phi.T @ phi * scale, info * scale, atol=1e-7 * size)
    np.testing.assert_allclose(phi.T @ w * sds, score * sds, atol=1e-7 * np.abs(score * sds).max())
    # one sign after another, in the order in which they were passed
    assert all((np.diff(r.t) >= 0.0).all() for r in selection.linear.rows)


def test_what_signs_share_is_marginalised(fit: CameraFit, selection: Selection) -> None:
    info, score = equations(fit)
    k = len(keys())
    prior = np.diag(fit.boxes.prior_sd()[k:] ** -2.0)
    inner = np.linalg.solve(info[k:, k:] + prior, np.column_stack([info[k:, :k], score[k:]]))
    left = info[:k, :k] - info[:k, k:] @ inner[:, :-1]
    rest = score[:k] - info[:k, k:] @ inner[:, -1]
    known = selection.given(Chosen())
    np.testing.assert_allclose(known.score[:k], rest, rtol=1e-6)
    np.testing.assert_allclose(known.diagonal[:k], np.diag(left), rtol=1e-6)
    # the Bayes factor of one parameter, written out
    i = keys().index(("camera_boresight", "yaw"))
    sd = next(p.prior_sd for p in CATALOGUE["camera_boresight"].parameters if p.name == "yaw")
    by_scale = []
    for factor in (1.0, 5.0):
        room = 1.0 + left[i, i] * (factor * sd) ** 2
        by_scale.append(0.5 * rest[i] ** 2 * (factor * sd) ** 2 / room - 0.5 * np.log(room))
    assert plain_nats(known, (i,))[0] == pytest.approx(max(by_scale) - np.log(2.0), rel=1e-6)


def test_only_errors_of_the_camera_are_candidates(fit: CameraFit) -> None:
    some = selection_of(fit, ["camera_focal", "camera_boresight"])
    assert set(some.candidates) == {"camera_focal", "camera_boresight"}
    assert [len(p) for p in some.candidates["camera_boresight"].parts] == [1, 1, 1]
