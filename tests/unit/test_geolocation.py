"""Signs located in an exact world with noisy boxes."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import ORIGIN, Scene, boxes, camera, drive_path, roadside

from automap.earth import local_ned
from automap.geolocation.landmark import (
    SizePrior,
    boxes_of,
    by_expected_heights,
    columns_of,
    fit_landmark,
    position_jacobian,
)
from automap.geolocation.landmark_kernels import N_COMMON, RADIAL, normal_equations
from automap.geolocation.locate import locate_signs
from automap.geolocation.result import GeolocationResult
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.tracking import link_views
from automap.geolocation.views import CameraCorrection, MeasurementNoise, build_views
from automap.mapping.sureness import class_probabilities, group_probabilities
from automap.records import UNKNOWN_FOCAL_SD, Detections, Trajectory
from automap.records.pictures import usual_matrix
from automap.robust import BY_CAUCHY, PLAIN

CENTRE = np.array([[0.0, 0.0, 640.0], [0.0, 0.0, 360.0], [0.0, 0.0, 0.0]])


def positions(result: GeolocationResult) -> np.ndarray:
    """Signs [n, 3] in the tangent plane of the scene."""
    signs = result.signs
    return local_ned(
        np.array([s.lat_rad for s in signs]),
        np.array([s.lon_rad for s in signs]),
        np.array([s.height_m for s in signs]),
        ORIGIN,
    )


def nearest_errors(result: GeolocationResult, scene: Scene) -> np.ndarray:
    """Distance [n] of every true sign to the nearest located one."""
    found = positions(result)
    return np.linalg.norm(scene.position[:, None] - found[None], axis=2).min(axis=1)


def take(detections: Detections, rows: np.ndarray) -> Detections:
    return Detections(
        frame=detections.frame[rows],
        t_ns=detections.t_ns[rows],
        class_name=detections.class_name[rows],
        box=detections.box[rows],
        score=detections.score[rows],
        track=detections.track[rows],
    )


@pytest.fixture(scope="module")
def world() -> tuple[Trajectory, Scene, Detections, np.ndarray]:
    path = drive_path()
    scene = roadside(path)
    found, owner = boxes(path, scene, camera(), np.random.default_rng(3))
    return path, scene, found, owner


def test_every_sign_is_found_once_and_in_place(world) -> None:
    path, scene, found, owner = world
    seen = np.unique(owner)
    result = locate_signs(path, [found], {"front": camera()})
    assert len(result.signs) == len(seen)
    errors = nearest_errors(result, replace(scene, position=scene.position[seen]))
    assert errors.max() < 1.0
    assert np.median(errors) < 0.3
    assert [s.id for s in result.signs] == [f"s{k:04d}" for k in range(1, len(seen) + 1)]


@pytest.mark.slow
def test_what_is_said_about_a_sign(world) -> None:
    path, scene, found, _ = world
    result = locate_signs(path, [found], {"front": camera()})
    place = positions(result)
    way = local_ned(path.lat_rad, path.lon_rad, path.height_m, ORIGIN)[:, :2]
    for sign, p in zip(result.signs, place, strict=True):
        k = int(np.linalg.norm(scene.position - p, axis=1).argmin())
        assert sign.class_name == scene.class_name[k]
        assert sign.side == ("right" if k % 2 == 0 else "left")
        assert (sign.path_offset_m > 0.0) == (sign.side == "right")
        away = np.hypot(*(way - p[:2]).T).min()
        assert abs(sign.path_offset_m) == pytest.approx(away, abs=0.05)
        assert sign.status == "ok"
        assert sign.size_m == pytest.approx(0.75, abs=0.08)
        assert sign.height_above_road_m == pytest.approx(3.2, abs=0.4)
        # the sign faces the oncoming car: against the course of the path beside it
        row = 600 + 400 * k
        course = path.rpy[min(row, len(path) - 1), 2]
        off = (sign.facing_rad - course - np.pi + np.pi) % (2 * np.pi) - np.pi
        assert abs(off) < 0.6
        assert 0.0 < sign.confidence <= 1.0
        assert np.linalg.eigvalsh(sign.cov_enu)[0] > 0.0


@pytest.mark.slow
def test_what_the_detector_told_of_the_class_comes_through(world) -> None:
    path, _, found, _ = world
    n = len(found)
    # a third of each sign's boxes are called after another class of the same shape and colour
    other = "regulatory--maximum-speed-limit-20--g1"
    named = np.where(np.arange(n) % 3 == 0, other, "regulatory--maximum-speed-limit-60--g1")
    told = replace(
        found,
        class_name=named.astype(object),
        score=np.full(n, 0.8),
        class_probability=np.full(n, 0.9),
        group_probability=np.full(n, 0.95),
    )
    # boxes of one class are told once, as two drives that read two classes of a group are
    both, one = np.array([0, 1]), np.zeros(1, np.int64)
    own, names = np.zeros(2, np.int64), ["regulatory--maximum-speed-limit-60--g1", other]
    of_class = class_probabilities(both, np.full(2, 0.9), own, one)[0]
    of_group = group_probabilities(both, names, np.full(2, 0.95), own, one)[0]
    assert 0.25 < of_class < 0.5 < 0.95 < of_group
    for sign in locate_signs(path, [told], {"front": camera()}).signs:
        share = np.mean(named[sign.detection_rows] == sign.class_name)
        assert 0.5 < share < 1.0
        assert sign.class_probability == pytest.approx(of_class)
        assert sign.group_probability == pytest.approx(of_group)
        assert sign.confidence == pytest.approx(sign.existence * sign.class_probability)
    for sign in locate_signs(path, [found], {"front": camera()}).signs:
        assert np.isnan([sign.class_probability, sign.group_probability]).all()


def test_every_detection_is_accounted_for(world) -> None:
    path, _, found, owner = world
    result = locate_signs(path, [found], {"front": camera()})
    observations = result.observations
    assert observations.used.mean() > 0.97
    for sign in result.signs:
        rows = sign.detection_rows
        assert (observations.sign_id[rows] == sign.id).all()
        assert len(np.unique(owner[rows])) == 1
    assert (observations.note[observations.used] == "").all()
    assert (observations.note[~observations.used] != "").all()
    assert np.sqrt(np.nanmean(observations.residual_px**2)) == pytest.approx(1.0, abs=0.3)


@pytest.mark.slow
def test_covariance_fits_the_error() -> None:
    """Errors drawn as the model takes them: boxes, attitude from frame to frame, and for each
    sign a turn and an offset of the stamps of its own."""
    path = drive_path(sd_m=1e-3)
    scene = roadside(path, every_s=3.0)
    squares = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        found, owner = boxes(path, scene, camera(), rng, noise_px=2.5)
        n = len(scene.position)
        shift = np.tile(rng.normal(0.0, 7.5, (n, 2)), (1, 2))[owner]
        stamp = found.t_ns + (rng.normal(0.0, 0.02, n)[owner] * 1e9).astype(np.int64)
        order = np.argsort(stamp, kind="stable")
        noisy = take(replace(found, box=found.box + shift, t_ns=stamp), order)
        result = locate_signs(path, [noisy], {"front": camera()})
        for sign, p in zip(result.signs, positions(result), strict=True):
            error = scene.position - p
            error = error[np.linalg.norm(error, axis=1).argmin()]
            enu = np.array([error[1], error[0]])
            squares.append(enu @ np.linalg.solve(sign.cov_enu[:2, :2], enu))
    assert np.mean(np.array(squares) < 5.99) > 0.85
    assert 0.7 < np.mean(squares) < 4.0  # two degrees of freedom


@pytest.mark.slow
def test_the_trajectory_error_is_not_averaged_away(world) -> None:
    path, _, found, _ = world
    result = locate_signs(path, [found], {"front": camera()})
    for sign in result.signs:
        assert min(sign.cov_enu[0, 0], sign.cov_enu[1, 1]) > 0.5**2


def test_two_signs_on_one_post_stay_two() -> None:
    path = drive_path(duration_s=12.0)
    one = roadside(path, every_s=100.0)
    above = one.position - np.array([0.0, 0.0, 0.9])
    pair = Scene(np.vstack([one.position, above]), np.full(2, 0.75), ("a", "a"))
    found, _ = boxes(path, pair, camera(), np.random.default_rng(1))
    result = locate_signs(path, [found], {"front": camera()})
    assert len(result.signs) == 2
    assert nearest_errors(result, pair).max() < 1.0


@pytest.mark.slow
def test_class_noise_and_missing_boxes_do_not_break_tracks(world) -> None:
    path, _, found, owner = world
    rng = np.random.default_rng(9)
    keep = rng.random(len(found)) > 0.3
    names = found.class_name.copy()
    names[rng.random(len(found)) < 0.15] = "another"
    thinned = take(replace(found, class_name=names), np.flatnonzero(keep))
    result = locate_signs(path, [thinned], {"front": camera()})
    seen = np.unique(owner[keep])
    assert len(result.signs) == len(seen)
    classes = {s.class_name for s in result.signs}
    assert "another" not in classes


@pytest.mark.slow
def test_false_boxes_do_not_pull_signs_away(world) -> None:
    path, scene, found, owner = world
    rng = np.random.default_rng(5)
    box = found.box.copy()
    wild = rng.choice(len(found), 12, replace=False)
    box[wild] += rng.uniform(40.0, 120.0, (12, 1)) * rng.choice([-1.0, 1.0], (12, 1))
    result = locate_signs(path, [replace(found, box=box)], {"front": camera()})
    seen = np.unique(owner)
    errors = nearest_errors(result, replace(scene, position=scene.position[seen]))
    assert errors.max() < 1.5
    good = [s for s in result.signs if s.status == "ok" and s.n_views > 3]
    assert len(good) == len(seen)


@pytest.mark.slow
def test_a_turned_camera_is_found_out() -> None:
    path = drive_path(duration_s=60.0)
    scene = roadside(path, every_s=2.5)
    truth = camera()
    found, _ = boxes(path, scene, truth, np.random.default_rng(2))
    turn = np.radians([0.0, 0.0, 1.5])
    believed = camera(mount_rpy=truth.mount_rpy + turn, mount_sd=np.radians(2.0))
    result = locate_signs(path, [found], {"front": believed})
    correction = result.corrections["front"]
    sd = np.sqrt(np.diag(correction.covariance))
    assert np.degrees(correction.turn[2]) == pytest.approx(-1.5, abs=0.3)
    assert abs(correction.turn[2] + turn[2]) < 3.0 * sd[2]
    fixed = GeolocationRules(estimate_camera=False)
    without = locate_signs(path, [found], {"front": believed}, fixed)
    assert np.median(nearest_errors(result, scene)) < 0.6 * np.median(
        nearest_errors(without, scene)
    )


@pytest.mark.slow
def test_the_focal_length_of_a_camera_of_no_calibration_is_told_with_its_sigma(world) -> None:
    path, scene, found, owner = world
    believed = camera(matrix=usual_matrix(1280, 720), focal_sd=UNKNOWN_FOCAL_SD)
    result = locate_signs(path, [found], {"front": believed})
    (told,) = (text for text in result.warnings if "the boxes make its focal length" in text)
    focal, sd = (int(number) for number in re.findall(r"\d+", told)[:2])
    # 1000 px, where a view of 60 degrees is 1109, give or take 333
    assert 0 < sd < 100
    assert abs(focal - 1000) < 3 * sd + 1
    seen = replace(scene, position=scene.position[np.unique(owner)])
    assert np.median(nearest_errors(result, seen)) < 0.4
    calibrated = locate_signs(path, [found], {"front": camera()})
    assert not any("focal length" in text for text in calibrated.warnings)


def test_a_sign_seen_once_is_placed_by_its_size_and_flagged(world) -> None:
    path, scene, found, owner = world
    first = np.flatnonzero(owner == owner[0])[-1:]
    result = locate_signs(path, [take(found, first)], {"front": camera()})
    (sign,) = result.signs
    assert sign.status == "single_view"
    error = np.linalg.norm(positions(result)[0] - scene.position[owner[0]])
    assert error < 3.0 * np.sqrt(np.trace(sign.cov_enu))
    assert np.sqrt(np.trace(sign.cov_enu)) > 1.0


def test_a_distant_single_box_is_counted_and_left_out(world) -> None:
    path, _, found, _ = world
    tiny = take(found, np.array([0]))
    x, y = tiny.box[0, :2]
    tiny = replace(tiny, box=np.array([[x, y, x + 3.0, y + 3.0]]))
    result = locate_signs(path, [tiny], {"front": camera()})
    assert result.signs == []
    assert result.observations.note[0] == "too_far"
    assert "1 of 1 detections" in result.warnings[0]


@pytest.mark.slow
def test_frames_outside_the_trajectory_are_counted(world) -> None:
    path, _, found, _ = world
    shifted = replace(found, t_ns=found.t_ns + np.int64(30e9))
    result = locate_signs(path, [shifted], {"front": camera()})
    late = shifted.t_ns > path.t_ns[-1]
    assert (result.observations.note[late] == "no_pose").all()
    assert any("outside the trajectory" in text for text in result.warnings)


@pytest.mark.slow
def test_a_mirrored_video_is_told_and_the_right_one_is_not(world) -> None:
    path, _, found, _ = world
    right = locate_signs(path, [found], {"front": camera()})
    assert not any("What is wrong" in text for text in right.warnings)
    x_min, y_min, x_max, y_max = found.box.T
    width = camera().width
    mirrored = replace(found, box=np.stack([width - x_max, y_min, width - x_min, y_max], axis=1))
    wrong = locate_signs(path, [mirrored], {"front": camera()})
    assert any("What is wrong with camera front was not found" in text for text in wrong.warnings)
    assert {sign.status for sign in wrong.signs} == {"doubtful"}


def test_nothing_in_gives_nothing_out(world) -> None:
    path, _, found, _ = world
    result = locate_signs(path, [take(found, np.arange(0))], {"front": camera()})
    assert result.signs == []
    assert result.warnings == []


@pytest.mark.slow
def test_broken_boxes_are_left_out_not_fatal(world) -> None:
    path, _, found, _ = world
    box = found.box.copy()
    box[0] = np.nan
    box[1, 3] = box[1, 1]
    box[2, 3] = box[2, 1] - 5.0
    box[3, 1:4:2] = -1e3, 2e3  # taller than the picture
    result = locate_signs(path, [replace(found, box=box)], {"front": camera()})
    assert (result.observations.note[:4] == "no_direction").all()
    assert len(result.signs) > 5


@pytest.mark.slow
def test_a_front_of_a_house_as_large_as_the_picture_does_not_end_the_others() -> None:
    """A sign of its class's size with such a box would touch the lens."""
    path, wide = drive_path(), camera(matrix=np.diag([500.0, 500.0, 1.0]) + CENTRE)
    scene = roadside(path)
    found, owner = boxes(path, scene, wide, np.random.default_rng(3))
    box = found.box.copy()
    of_house = owner == owner[0]
    centre = 0.5 * (box[of_house, :2] + box[of_house, 2:])
    box[of_house] = np.hstack([centre - 350.0, centre + 350.0])
    result = locate_signs(path, [replace(found, box=box)], {"front": wide})
    others = replace(scene, position=scene.position[np.unique(owner[~of_house])])
    assert nearest_errors(result, others).max() < 1.0


def test_two_passes_of_one_street_are_one_sign() -> None:
    """The same boxes an hour later, by a trajectory that has moved two metres sideways."""
    path = drive_path(sd_m=1.5)
    scene = roadside(path)
    found, owner = boxes(path, scene, camera(), np.random.default_rng(3))
    later = np.int64(3600e9)
    again = replace(path, t_ns=path.t_ns + later, gps_s=path.gps_s + 3600.0)
    again = replace(again, lat_rad=again.lat_rad + 2.0 / 6.36e6)
    joined = Trajectory(
        **{
            name: np.concatenate([getattr(path, name), getattr(again, name)])
            for name in Trajectory.__dataclass_fields__
        }
    )
    both = Detections(
        frame=np.concatenate([found.frame, found.frame + 100000]),
        t_ns=np.concatenate([found.t_ns, found.t_ns + later]),
        class_name=np.tile(found.class_name, 2),
        box=np.tile(found.box, (2, 1)),
        score=np.tile(found.score, 2),
        track=np.tile(found.track, 2),
    )
    result = locate_signs(joined, [both], {"front": camera()})
    assert len(result.signs) == len(np.unique(owner))
    once = locate_signs(path, [found], {"front": camera()})
    # half way between the passes, and surer than one of them
    shift = np.median(positions(result)[:, 0] - positions(once)[:, 0])
    assert shift == pytest.approx(1.0, abs=0.3)
    assert result.signs[0].cov_enu[0, 0] < once.signs[0].cov_enu[0, 0]


@pytest.mark.slow
def test_a_long_wait_adds_no_certainty() -> None:
    """A car that waits in sight of a sign sees the same error again and again."""
    path = drive_path(duration_s=9.0, sd_m=1e-3)
    found, owner = boxes(path, roadside(path), camera(), np.random.default_rng(0))
    first = take(found, np.flatnonzero(owner == owner[0])[:2])
    n = 2000
    waiting = take(first, np.zeros(n, np.int64))
    box = waiting.box + np.random.default_rng(1).normal(0.0, 1.0, (n, 4))
    path = drive_path(duration_s=300.0, speed=0.0, turn_rate=0.0, sd_m=1e-3)
    stamps = path.t_ns[0] + np.arange(n) * np.int64(1e8)
    waiting = replace(waiting, box=box, t_ns=stamps, frame=np.arange(n))
    fixed = GeolocationRules(estimate_camera=False)
    (long,) = locate_signs(path, [waiting], {"front": camera()}, fixed).signs
    (short,) = locate_signs(path, [take(waiting, np.arange(3))], {"front": camera()}, fixed).signs
    assert long.n_views == n
    assert np.trace(long.cov_enu) == pytest.approx(np.trace(short.cov_enu), rel=0.3)


def test_track_numbers_of_a_detector_are_used(world) -> None:
    path, _, found, owner = world
    views = build_views(
        path, [replace(found, track=owner)], {"front": camera()}, MeasurementNoise()
    )
    tracks = link_views(views, SizePrior(), 20.0)
    assert len(tracks) == len(np.unique(owner))
    for rows in tracks:
        assert len(np.unique(views.track[rows])) == 1


def test_derivatives_against_differences(world) -> None:
    """The effect of turn, time offset, focal length and distortion, against a camera that has
    them."""
    path, _, found, owner = world
    rows = np.flatnonzero(owner == np.bincount(owner).argmax())
    view = camera()
    noise = MeasurementNoise()
    views = build_views(path, [take(found, rows)], {"front": view}, noise)
    prior = SizePrior()
    landmark = fit_landmark(views, np.arange(len(views)), prior, robust=False)
    at = landmark.rows, landmark.anchor
    boxes = by_expected_heights(boxes_of(views, *at, prior), landmark.parameters)
    columns = columns_of(views, *at, landmark.parameters)[0]
    N, A, *_ = normal_equations(landmark.parameters, boxes, columns, np.zeros(N_COMMON), PLAIN)
    by_common = -np.linalg.solve(N, A)

    def shifted(change: np.ndarray) -> np.ndarray:
        rest = {"focal_log": change[4], "radial": change[RADIAL]}
        correction = CameraCorrection(change[:3], change[3], np.eye(10), **rest)
        moved = build_views(
            path, [take(found, rows)], {"front": view}, noise, {"front": correction}
        )
        return fit_landmark(moved, np.arange(len(moved)), prior, robust=False).position

    for k, step in {0: 2e-4, 1: 2e-4, 2: 2e-4, 3: 2e-3, 4: 1e-3, RADIAL: 2e-3}.items():
        change = np.zeros(N_COMMON)
        change[k] = step
        up, down = shifted(change), shifted(-change)
        numeric = (up - down) / (2.0 * step)
        effect = position_jacobian(views, landmark) @ by_common[:, k]
        np.testing.assert_allclose(effect, numeric, atol=0.02 * np.abs(numeric).max())


def test_gradient_vanishes_at_the_solution(world) -> None:
    path, _, found, owner = world
    rows = np.flatnonzero(owner == 1)
    views = build_views(path, [take(found, rows)], {"front": camera()}, MeasurementNoise())
    every = np.arange(len(views))
    prior = SizePrior()
    landmark = fit_landmark(views, every, prior)
    columns, _ = columns_of(views, every, landmark.anchor, landmark.parameters)
    boxes = boxes_of(views, every, landmark.anchor, prior)
    boxes = by_expected_heights(boxes, landmark.parameters)
    N, _, shared, *_ = normal_equations(
        landmark.parameters, boxes, columns, np.zeros(N_COMMON), BY_CAUCHY
    )
    step = np.linalg.solve(N, shared[N_COMMON:, N_COMMON])
    assert np.abs(step).max() < 1e-2 * np.sqrt(np.diag(landmark.covariance)).max()
