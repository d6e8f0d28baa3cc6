"""What signs say of a camera, against all unknowns solved at once; when a camera is doubted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import comb
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geolocation_scene import boxes, camera, drive_path, roadside

from automap.gates import gate, sigmas
from automap.geolocation import boresight, camera_explanation, carriers, limits
from automap.geolocation.boresight import evidence_of, prior_covariance, solve_camera
from automap.geolocation.camera_doubt import as_unknown, beyond_stated, doubtful, misfit
from automap.geolocation.landmark import SizePrior, fit_landmark
from automap.geolocation.landmark_kernels import N_COMMON, Boxes
from automap.geolocation.pass_errors import equations
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.track_evidence import NOTHING_TOLD
from automap.geolocation.views import CameraCorrection, MeasurementNoise, build_views
from automap.records import UNKNOWN_DISTORTION_SD, FloatArray


def positive(rng: np.random.Generator, n: int, scale: FloatArray) -> FloatArray:
    """A full information matrix of quantities that are of the sizes ``scale`` [n]."""
    root = rng.normal(size=(n, n + 3))
    return np.asarray((root @ root.T) / np.outer(scale, scale))


def test_priors_of_a_camera_are_its_sigmas_in_the_order_of_its_errors() -> None:
    view = camera(mount_sd=0.01, time_offset_sd=0.02, lever_arm_sd=0.3, distortion_sd=0.07)
    rules = GeolocationRules(focal_sd=0.004, camera_margin_sd_px=3.0)
    sd = np.sqrt(np.diag(prior_covariance(view, rules)))
    # of a thousand pixels
    assert sd == pytest.approx([0.01] * 3 + [0.02, 0.004] + [0.3] * 3 + [0.003, 0.07])


@pytest.mark.parametrize("before", [np.zeros(10), np.linspace(-0.01, 0.02, 10)])
def test_a_camera_is_the_mean_of_its_signs_with_attitude_errors_of_their_minutes(
    before: FloatArray,
) -> None:
    """Camera and the attitude's error of each window as unknowns of one dense problem."""
    rng = np.random.default_rng(1)
    view, priors = camera(lever_arm_sd=0.2), GeolocationRules()
    prior = prior_covariance(view, priors)
    scale = np.sqrt(np.diag(prior))
    window = limits.ATTITUDE_WINDOW_S
    t_s = np.array([0.0, 0.4 * window, 0.99 * window, 1.01 * window, 3.5 * window])
    views: Any = SimpleNamespace(t_ns=np.int64(5e12) + np.rint(t_s * 1e9).astype(np.int64))
    marks: Any = [SimpleNamespace(rows=np.array([k])) for k in range(5)]
    evidence = [(positive(rng, 10, scale), rng.normal(size=10) / scale) for _ in range(5)]
    variance = [rng.uniform(0.2, 2.0, 3) * scale[:3] ** 2 for _ in range(5)]
    # what all have in common, then each window's own
    number = np.array([0, 0, 0, 1, 2])
    N, g = np.zeros((19, 19)), np.zeros(19)
    held = prior.copy()
    held[5:8, 5:8] = 1e-12 * np.eye(3)
    N[:10, :10] = np.linalg.inv(held)
    g[:10] = -N[:10, :10] @ before
    for k in range(3):
        at = slice(10 + 3 * k, 13 + 3 * k)
        members = np.flatnonzero(number == k)
        N[at, at] = np.diag(1.0 / np.mean([variance[m] for m in members], axis=0))
        for m in members:
            design = np.zeros((10, 19))
            design[:, :10] = np.eye(10)
            design[:3, at] = np.eye(3)
            N += design.T @ evidence[m][0] @ design
            g += design.T @ evidence[m][1]
    joint = np.linalg.inv(N)
    found, covariance = solve_camera(views, marks, evidence, variance, before, view, priors)
    free = [0, 1, 2, 3, 4, 8, 9]
    assert found[free] == pytest.approx((before + (joint @ g)[:10])[free], rel=1e-6)
    np.testing.assert_allclose(
        covariance[np.ix_(free, free)] / np.outer(scale[free], scale[free]),
        joint[np.ix_(free, free)] / np.outer(scale[free], scale[free]),
        rtol=1e-6, atol=1e-9,
    )  # fmt: skip
    np.testing.assert_allclose(covariance[5:8], prior[5:8])
    np.testing.assert_allclose(covariance[:, 5:8], prior[:, 5:8])


@pytest.mark.parametrize("noise_px", [0.3, 12.0])
def test_what_a_sign_says_of_a_camera_has_its_place_and_its_passs_errors_taken_out(
    noise_px: float,
) -> None:
    """Sign, camera and the errors of the pass as unknowns of one dense problem; boxes that scatter
    by more than is stated say less by that."""
    path = drive_path(14.0)
    found, owner = boxes(
        path, roadside(path), camera(), np.random.default_rng(2), noise_px=noise_px
    )
    views = build_views(path, [found], {"front": camera()}, MeasurementNoise())
    rows = np.flatnonzero(owner[views.row] == np.bincount(owner).argmax())
    prior = SizePrior()
    mark = fit_landmark(views, rows, prior)
    sd = np.array([1e-3, 2e-3, 3e-3, 5e-3, 1e-2, 0.1, 0.1, 0.1, 2e-3, 0.02, 0.05, 0.06, 0.07])
    N, A, shared, _, _, chi2, _ = equations(views, mark, mark.parameters, np.zeros(N_COMMON), prior)
    scale = max(1.0, chi2 / mark.dof)
    assert (scale > 1.2) == (noise_px > 5.0)
    S, s, g = shared[:N_COMMON, :N_COMMON], shared[:N_COMMON, -1], shared[N_COMMON:, -1]
    whole = np.block([[N, A, A], [A.T, S, S], [A.T, S, S]]) / scale
    whole[-N_COMMON:, -N_COMMON:] += np.diag(sd**-2)
    right = np.concatenate([g, s, s]) / scale
    size = np.sqrt(np.diag(whole))
    whole, right = whole / np.outer(size, size), right / size
    of = np.arange(4, 4 + N_COMMON)
    other = np.setdiff1d(np.arange(len(whole)), of)
    gone = whole[np.ix_(of, other)] @ np.linalg.inv(whole[np.ix_(other, other)])
    information = whole[np.ix_(of, of)] - gone @ whole[np.ix_(other, of)]
    pull = right[of] - gone @ right[other]
    own, step = evidence_of(views, mark, prior, sd)
    # none says more of an error than what it is of the pass
    unit = sd[:10]
    information *= np.outer(size[of], size[of])
    np.testing.assert_allclose(
        own * np.outer(unit, unit), information[:10, :10] * np.outer(unit, unit), atol=1e-6
    )
    np.testing.assert_allclose(step * unit, (size[of] * pull)[:10] * unit, atol=1e-5)


def test_signs_of_another_camera_with_few_views_or_without_a_place_say_nothing_of_it() -> None:
    views: Any = SimpleNamespace(camera=np.array([0] * 6 + [1] * 6))
    least = limits.CAMERA_VIEWS

    def mark(first: int, count: int, ok: bool = True) -> Any:
        return SimpleNamespace(rows=np.arange(first, first + count), ok=ok)

    marks = [mark(0, least), mark(0, least - 1), mark(6, least), mark(4, least), mark(1, 5, False)]
    assert boresight.usable_landmarks(views, marks, 0) == [marks[0]]
    assert boresight.usable_landmarks(views, marks, 1) == [marks[2]]


@pytest.mark.parametrize("k", range(6))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_camera_is_beyond_what_is_stated_by_its_own_sigmas(k: int, sign: float) -> None:
    view = camera(mount_sd=0.01, time_offset_sd=0.02, distortion_sd=0.03)
    sd = [0.01, 0.01, 0.01, 0.02, 0.004, 0.03]
    most = sigmas(limits.BEYOND_MANIFEST_PROBABILITY)
    for factor in (0.99, 1.01):
        values = np.zeros(6)
        values[k] = sign * factor * most * sd[k]
        rest = {"focal_log": values[4], "radial": values[5]}
        found = CameraCorrection(values[:3], values[3], np.eye(10), **rest)
        assert beyond_stated(found, view, 0.004) == (factor > 1.0)
    # the margin is the detector's
    wide = CameraCorrection(np.zeros(3), 0.0, np.eye(10), margin=1.0)
    assert not beyond_stated(wide, view, 0.004)


def test_a_camera_is_let_go_but_not_held_closer_than_stated() -> None:
    sure, unsure = (
        camera(mount_sd=1e-4, time_offset_sd=1e-4),
        camera(mount_sd=2.0, time_offset_sd=9.0),
    )
    assert as_unknown(sure).mount_sd == limits.DOUBTED_TURN_RAD
    assert as_unknown(sure).time_offset_sd == limits.DOUBTED_TIME_S
    assert as_unknown(sure).distortion_sd == UNKNOWN_DISTORTION_SD
    assert as_unknown(sure).focal_sd == limits.DOUBTED_FOCAL
    assert (as_unknown(unsure).mount_sd, as_unknown(unsure).time_offset_sd) == (2.0, 9.0)


def statuses(weak: int, of: int) -> Any:
    some = [SimpleNamespace(status="weak_geometry")] * weak
    return some + [SimpleNamespace(status="ok")] * (of - weak)


def test_weak_signs_are_told_beyond_what_chance_makes_of_their_usual_share() -> None:
    """Against the sum of the binomial distribution's tail."""
    n, p = 40, limits.USUAL_WEAK
    tail = [
        sum(comb(n, k) * p**k * (1.0 - p) ** (n - k) for k in range(weak, n + 1))
        for weak in range(n + 1)
    ]
    least = int(np.argmax(np.array(tail) <= limits.MISFIT_PROBABILITY))
    used, note = np.ones(60, bool), np.full(60, "", object)
    alone = [SimpleNamespace(status="single_view")] * 50
    for weak in (0, 1, least - 1, least, least + 1, n):
        told = misfit(used, note, statuses(weak, n) + alone)
        assert bool(told) == (weak >= least)
        if told:
            assert f"{weak} of {n} signs" in told[0]


def test_boxes_are_told_to_be_lost_where_half_of_many_are() -> None:
    least = limits.LEAST_LOST
    for count, lost, wanted in (
        (least, limits.LOST_SHARE, True), (least, limits.LOST_SHARE - 0.02, False),
        (least - 2, 1.0, False),
    ):  # fmt: skip
        # those that nothing could be placed by do not count
        note = np.array(["no_pose", "no_direction", "too_far", "back"] * 30 + [""] * count, object)
        used = np.zeros(len(note), bool)
        used[120 + round(lost * count) :] = True
        told = misfit(used, note, statuses(0, 5))
        assert bool(told) == wanted
        if told:
            assert f"{lost:.0%} of them" in told[0]


def test_a_doubtful_sign_is_as_unsure_as_it_was_far() -> None:
    @dataclass(frozen=True)
    class Sign:
        status: str
        cov_enu: FloatArray
        confidence: float
        existence: float

    sign: Any = Sign("ok", np.diag([1.0, 2.0, 3.0]), 0.5, 0.9)
    found = doubtful(sign, 12.0)
    np.testing.assert_allclose(found.cov_enu, np.diag([145.0, 146.0, 147.0]))
    assert found.status == "doubtful"
    assert found.confidence == pytest.approx(0.5 * limits.IMPLAUSIBLE_CONFIDENCE)
    assert found.existence == pytest.approx(0.9 * limits.IMPLAUSIBLE_CONFIDENCE)


def test_a_cameras_rows_are_where_its_record_lies_among_all() -> None:
    class Record(SimpleNamespace):
        def __len__(self) -> int:
            return int(self.count)

    records: Any = [Record(camera=c, count=n) for c, n in (("a", 3), ("b", 5), ("c", 2))]
    notes = [np.full(len(one), "", object) for one in records]
    notes[1][2] = "moving"
    trial = camera_explanation.Trial(records, {}, Any, notes)  # type: ignore[arg-type]
    found = {name: trial.rows(name).tolist() for name in "abc"}
    assert found == {"a": [0, 1, 2], "b": [3, 4, 6, 7], "c": [8, 9]}


def located(used: FloatArray, scales: tuple[float, ...]) -> Any:
    return SimpleNamespace(
        observations=SimpleNamespace(
            used=np.asarray(used, bool), note=np.full(len(used), "", object),
            sign_id=np.array(["s"] * len(used), object),
        ),
        noise=SimpleNamespace(scales=scales), signs=[],
        corrections={"a": SimpleNamespace(time_s=0.0)},
    )  # fmt: skip


def test_boxes_fit_where_most_are_used_and_they_scatter_as_boxes_do() -> None:
    most = limits.SCATTER_LIMITS[1]
    rows = np.arange(10, 110)
    for share, scales, wanted in (
        (limits.FITS_SHARE, (1.0, 1.0, 9.0), True),
        (limits.FITS_SHARE - 0.01, (1.0, 1.0, 1.0), False),
        (1.0, (most, most, 1.0), False),
        (1.0, (most, 1.0, most), True),
        (1.0, (1.0, most, 1.0), True),
    ):
        used = np.zeros(120)
        used[10 : 10 + round(100 * share)] = 1.0
        assert camera_explanation._fits(located(used, scales), rows) is wanted
    assert camera_explanation._scatter(located(np.ones(2), (3.0, 4.0, 9.0))) == pytest.approx(5.0)


@pytest.mark.parametrize(("share", "scatter", "taken"), [
    (0.5, 0.9 * limits.CLOSER_BOXES, True), (0.5, 1.1 * limits.CLOSER_BOXES, False),
    (0.5, 5.0, False), (0.5 + 1.1 * limits.MORE_BOXES, 5.0, True), (0.4, 0.1, False),
])  # fmt: skip
def test_an_explanation_places_more_boxes_or_places_them_closer(
    share: float, scatter: float, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of 200 boxes are placed as the camera is stated, with a scatter of one."""
    record: Any = type("Record", (SimpleNamespace,), {"__len__": lambda self: 200})(camera="a")
    view = camera()
    none = np.full(200, "", object)
    trial = camera_explanation.Trial([record], {"a": view}, GeolocationRules(), [none])

    def at(share: float, scatter: float) -> Any:
        return located(np.arange(200) < round(200 * share), (scatter, 0.0, 1.0))

    unknown = camera_explanation.as_unknown(replace(view, width=view.width + 9))
    monkeypatch.setattr(camera_explanation, "no_signs", lambda *_: none)
    stated = at(0.5, 1.0)

    zoomed = replace(unknown, matrix=unknown.matrix * [[1.1], [1.1], [1.0]])
    for worse, as_stated, assumed in (
        (1.0, True, unknown), (1.2, True, unknown), (1.3, False, unknown), (1.0, False, zoomed)
    ):  # fmt: skip
        one = camera_explanation.Hypothesis("mirrored", record, assumed)
        monkeypatch.setattr(camera_explanation, "better_explanations", lambda *_, one=one: [one])

        def locate(tried: camera_explanation.Trial, told: Any, worse: float = worse) -> Any:
            if tried.cameras["a"].width == view.width:
                return stated
            sure = tried.cameras["a"].mount_sd == view.mount_sd
            return at(share, scatter * (worse if sure else 1.0))

        known = "a", Any, trial, stated, locate, NOTHING_TOLD
        tried, found, what = camera_explanation._best_explanation(*known)  # type: ignore[arg-type]
        assert what == ("mirrored" if taken else "")
        assert (tried.cameras["a"].width != view.width) == taken
        # with it the camera is as stated in all else unless its boxes scatter clearly more so
        assert (tried.cameras["a"].mount_sd == view.mount_sd) == (taken and as_stated)
        wanted = scatter * (worse if as_stated else 1.0) if taken else 1.0
        assert found.noise.scales[0] == pytest.approx(wanted)


@pytest.mark.parametrize("excess", [0.5, 3.0])
@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_what_moves_along_is_likelier_by_the_gate_in_sigmas_that_its_boxes_show(
    excess: float, factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Costs are squares in stated sigmas, which are too small by the root of ``excess``."""
    dof, scale = 30, max(1.0, excess)
    moving = excess * dof
    lead = factor * gate(limits.CARRIER_PROBABILITY, 1) * scale
    standing = SimpleNamespace(anchor=2, cost=moving + lead, dof=dof, weight=np.ones(4))
    asked: list[tuple[FloatArray, FloatArray]] = []

    def solve(first: FloatArray, boxes: Boxes, *kinds: int) -> tuple[FloatArray, float]:
        asked.append((first, boxes.b))
        return first, moving + abs(float(boxes.b[0, 0]) - 0.1)

    measured = np.array([[0.1, 0.2, -3.0]] * 4)
    measured[2] = 0.3, -0.1, -2.0
    apart = 10.0 * np.arange(4.0)[:, None] * [1.0, 0.0, 0.0]
    stamps = 1_000_000_000 * np.arange(4)
    views: Any = SimpleNamespace(measured=measured, frame=np.arange(4), t_ns=stamps, centre=apart)
    prior = SizePrior(0.9)
    boxes = Boxes(
        *(np.zeros((4, 3, 3)), np.ones((4, 3)), measured, np.ones((4, 3)), np.zeros(4)),
        *(np.log(prior.size_m), prior.log_sd),
    )
    monkeypatch.setattr(carriers, "fit_landmark", lambda *_: standing)
    monkeypatch.setattr(carriers, "boxes_of", lambda *_: boxes)
    monkeypatch.setattr(carriers, "solve_landmark", solve)
    assert carriers.moves_along(views, np.arange(4), prior) == (factor > 1.0)
    # where its size puts it in the nearest view, and every part of the way that it comes near by
    wanted = [0.3, -0.1, np.log(0.9) + 2.0, np.log(0.9)]
    assert asked[0][0] == pytest.approx(wanted)
    parts = list(limits.CARRIER_CLOSING)
    assert [float(b[0, 0]) for _, b in asked] == pytest.approx(parts)
    # as fast as the camera, and nearer and away alike
    assert 0.0 in parts
    assert parts == sorted(parts) == [-part for part in reversed(parts)]


def test_refining_is_one_step_from_the_values_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """The solution's ten values and those of a correction are in one order."""
    values = np.arange(1.0, 11.0)
    seen: dict[str, Any] = {}

    def solve(views: Any, usable: Any, evidence: Any, attitude: Any, before: Any, *_: Any) -> Any:
        seen.update(before=before, attitude=attitude)
        return values, np.eye(10)

    mark = SimpleNamespace(rows=np.array([0, 1]))
    views: Any = SimpleNamespace(attitude_sd=np.array([[1.0, 2.0, 3.0], [3.0, 2.0, 1.0]]))
    monkeypatch.setattr(boresight, "usable_landmarks", lambda *_: [mark])
    monkeypatch.setattr(boresight, "pass_sd", lambda *_, **__: np.zeros(N_COMMON))
    monkeypatch.setattr(boresight, "evidence_of", lambda *_: (np.eye(10), np.zeros(10)))
    monkeypatch.setattr(boresight, "solve_camera", solve)
    rest: Any = (camera(), None, GeolocationRules())
    found = boresight.refine_correction(views, [], 0, *rest)
    assert found.turn.tolist() == [1.0, 2.0, 3.0]
    assert (found.time_s, found.focal_log, found.margin, found.radial) == (4.0, 5.0, 9.0, 10.0)
    assert seen["before"].tolist() == [0.0] * 10
    assert seen["attitude"][0] == pytest.approx([5.0, 4.0, 5.0])
    boresight.refine_correction(views, [], 0, camera(), found, GeolocationRules())
    assert np.delete(seen["before"], [5, 6, 7]).tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 9.0, 10.0]
    assert replace(found, time_s=0.0).values[3] == 0.0
