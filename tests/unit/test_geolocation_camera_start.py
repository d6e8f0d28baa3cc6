"""A camera that is far off: found before association; clutter; posts and gantries."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import ORIGIN, boxes, camera, drive_path, roadside

from automap.frames import matrix_to_rpy, rpy_to_matrix
from automap.geolocation import camera_explanation
from automap.geolocation.camera_hypotheses import (
    Hypothesis,
    _strided,
    better_explanations,
    contradicted,
)
from automap.geolocation.epipolar import _places_apart, first_correction
from automap.geolocation.locate import locate_signs
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.views import map_origin
from automap.mapping.posts import support_numbers
from automap.records import Detections, Trajectory


@pytest.fixture(scope="module")
def winding() -> Trajectory:
    """A drive whose turn rate changes sign, so that an offset in time shows."""
    from automap.earth import from_local_ned

    s = np.arange(0.0, 60.0, 0.01)
    rate = 0.25 * np.sin(2 * np.pi * s / 15.0)
    yaw = 0.7 + np.cumsum(rate) * 0.01
    velocity = 11.0 * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros_like(s)])
    lat, lon, height = from_local_ned(np.cumsum(velocity, axis=0) * 0.01, ORIGIN)
    return replace(
        drive_path(60.0),
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        vel_ned=velocity,
        rpy=np.column_stack([np.zeros_like(s), np.zeros_like(s), yaw]),
    )


def strided(found: Detections, stride: int) -> Detections:
    """What a detector that sees every so manieth frame finds, its frames numbered on their own."""
    kept = {k: v[found.frame % stride == 0] for k, v in vars(found).items() if np.ndim(v)}
    number = kept["frame"] // stride
    period_ns = np.ptp(found.t_ns) // np.ptp(found.frame)
    stamps = found.t_ns[0] + (number - found.frame[0]) * period_ns
    return replace(found, **{**kept, "frame": number, "t_ns": stamps})


def test_frames_that_a_detector_left_out_are_counted_as_far_as_the_path_goes(winding) -> None:
    found, _ = boxes(winding, roadside(winding, every_s=9.0), camera(), np.random.default_rng(1))
    counted = strided(found, 3)
    tried = list(_strided(Hypothesis("", counted, camera()), 60.0))
    assert [one.what.split()[7] for one in tried] == ["2", "3"]
    np.testing.assert_allclose(tried[1].found.t_ns, found.t_ns[found.frame % 3 == 0], atol=1e6)
    assert list(_strided(Hypothesis("", found, camera()), 60.0)) == []


def test_of_a_car_that_waits_boxes_now_and_then_tell_of_the_camera() -> None:
    path = drive_path(30.0)
    speed = np.where((path.t_ns - path.t_ns[0]) * 1e-9 < 10.0, 8.0, 0.0)
    path = replace(path, vel_ned=np.column_stack([speed, 0.0 * speed, 0.0 * speed]))
    frames = path.t_ns[0] + (np.arange(0.05, 29.9, 0.1) * 1e9).astype(np.int64)
    # two boxes a frame
    kept = _places_apart(path, np.repeat(frames, 2)).reshape(-1, 2)
    assert (kept[:, 0] == kept[:, 1]).all()
    seconds = (frames[kept[:, 0]] - path.t_ns[0]) * 1e-9
    assert np.sum(seconds < 10.0) == 100
    assert np.diff(seconds[seconds > 12.0]) == pytest.approx(2.0, abs=0.11)
    assert np.sum(seconds > 10.5) in (9, 10)


def test_turn_and_offset_before_any_link(winding) -> None:
    told = camera(mount_rpy=np.zeros(3), mount_sd=np.radians(4.0), time_offset_sd=0.15)
    true = replace(told, mount_rpy=np.radians([1.0, -4.0, 5.0]), time_offset_s=0.25)
    rng = np.random.default_rng(0)
    scene = roadside(winding, every_s=1.0)
    scene = replace(scene, position=scene.position + rng.normal(0.0, 1.0, scene.position.shape))
    found, _ = boxes(winding, scene, true, rng)
    x = first_correction(winding, found, told, map_origin(winding), 0.0015)
    assert x is not None
    turned = matrix_to_rpy(rpy_to_matrix(x[:3]))
    assert np.degrees(turned[1:]) == pytest.approx([-4.0, 5.0], abs=0.6)
    assert x[3] == pytest.approx(0.25, abs=0.02)


@pytest.mark.parametrize(("yaw_deg", "late_s"), [(10.0, 0.0), (0.0, 0.8)])
@pytest.mark.slow
def test_a_statement_that_the_boxes_contradict_is_not_held_to(
    winding, yaw_deg: float, late_s: float
) -> None:
    told = camera(mount_sd=np.radians(0.5), time_offset_sd=0.02)
    true = replace(
        told,
        mount_rpy=told.mount_rpy + np.radians([0.0, 0.0, yaw_deg]),
        time_offset_s=told.time_offset_s + late_s,
    )
    scene = roadside(winding, every_s=2.0)
    found, _ = boxes(winding, scene, true, np.random.default_rng(1))
    result = locate_signs(winding, [found], {"front": told})
    correction = result.corrections["front"]
    assert np.degrees(correction.turn[2]) == pytest.approx(yaw_deg, abs=0.3)
    assert correction.time_s == pytest.approx(late_s, abs=0.01)
    assert any("more than the manifest's sigmas allow" in text for text in result.warnings)
    assert result.observations.used.mean() > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("wrong", ["right", "fast", "mirrored", "backwards", "strided"])
def test_what_is_wrong_with_a_camera_is_found_and_told(winding, wrong: str) -> None:
    view = camera(mount_sd=np.radians(0.5), time_offset_sd=0.02)
    scene = roadside(winding, every_s=2.0)
    found, _ = boxes(winding, scene, view, np.random.default_rng(1))
    told = view
    if wrong == "fast":
        since = found.t_ns - found.t_ns[0]
        found = replace(found, t_ns=found.t_ns[0] + (since * 1.05).astype(np.int64))
    elif wrong == "mirrored":
        left, top, right, bottom = found.box.T
        wide = view.width - 1
        found = replace(found, box=np.column_stack([wide - right, top, wide - left, bottom]))
    elif wrong == "backwards":
        told = replace(view, mount_rpy=view.mount_rpy + np.array([0.0, 0.0, np.pi]))
    elif wrong == "strided":
        found = strided(found, 2)
    result = locate_signs(winding, [found], {"front": told})
    assumed = [text for text in result.warnings if "That was assumed" in text]
    words = {"fast": "frames take 0.95", "mirrored": "the picture is", "backwards": "the other way"}
    words["strided"] = "frame 1 of its boxes is frame 2"
    assert [words[wrong] in text for text in assumed] == ([] if wrong == "right" else [True])
    assert result.observations.used.mean() > 0.9
    assert {sign.status for sign in result.signs} == {"ok"}


@pytest.mark.slow
def test_two_cameras_that_are_not_as_stated_are_both_explained(winding) -> None:
    view = camera(mount_sd=np.radians(0.5), time_offset_sd=0.02)
    scene = roadside(winding, every_s=2.0)
    found, _ = boxes(winding, scene, view, np.random.default_rng(1))
    other, _ = boxes(winding, scene, view, np.random.default_rng(2))
    late = replace(other, t_ns=other.t_ns + 20 * 10**9, camera="second")
    behind = replace(view, mount_rpy=view.mount_rpy + np.array([0.0, 0.0, np.pi]))
    result = locate_signs(winding, [found, late], {"front": behind, "second": view})
    assumed = [text for text in result.warnings if "That was assumed" in text]
    assert ["front" in assumed[0], "second" in assumed[1]] == [True, True]
    assert ["the other way" in assumed[0], "s from their stamps" in assumed[1]] == [True, True]
    assert result.observations.used.mean() > 0.9
    assert {sign.status for sign in result.signs} == {"ok"}


@pytest.mark.slow
def test_the_best_explanation_of_a_mirrored_picture(winding) -> None:
    view = camera(mount_sd=np.radians(0.5), time_offset_sd=0.02)
    found, _ = boxes(winding, roadside(winding, every_s=4.0), view, np.random.default_rng(1))
    left, top, right, bottom = found.box.T
    wide = view.width - 1
    mirrored = replace(found, box=np.column_stack([wide - right, top, wide - left, bottom]))
    # on this level road what hangs high may as well hang low
    assert better_explanations(winding, mirrored, view)[0].what in (
        "the picture is mirrored",
        "the picture is upside down",
    )
    assert better_explanations(winding, found, view) == []


@pytest.mark.slow
def test_a_mirrored_picture_is_doubted_whatever_its_boxes_are_linked_to(winding) -> None:
    view = camera(mount_sd=np.radians(0.5), time_offset_sd=0.02)
    found, _ = boxes(winding, roadside(winding, every_s=20.0), view, np.random.default_rng(1))
    left, top, right, bottom = found.box.T
    wide = view.width - 1
    mirrored = replace(found, box=np.column_stack([wide - right, top, wide - left, bottom]))
    assert contradicted(winding, mirrored, view)
    assert not contradicted(winding, found, view)


@pytest.mark.slow
def test_rows_counted_from_the_bottom_show_where_the_road_is_not_level(winding) -> None:
    slope = np.radians(3.0) * np.sin(np.arange(len(winding.t_ns)) / 300.0)
    rise = np.tan(slope) * np.hypot(*winding.vel_ned[:, :2].T)
    hills = replace(
        winding,
        height_m=winding.height_m + np.cumsum(rise) * 0.01,
        vel_ned=winding.vel_ned - rise[:, None] * [0.0, 0.0, 1.0],
        rpy=winding.rpy + slope[:, None] * [0.0, 1.0, 0.0],
    )
    view = camera(mount_sd=np.radians(0.5), time_offset_sd=0.02)
    found, _ = boxes(hills, roadside(hills, every_s=12.0), view, np.random.default_rng(1))
    left, top, right, bottom = found.box.T
    high = view.height - 1
    counted = replace(found, box=np.column_stack([left, high - bottom, right, high - top]))
    assert contradicted(hills, counted, view)
    assert not contradicted(hills, found, view)


def test_what_is_of_no_sign_is_asked_anew_with_what_is_assumed(
    winding, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sign that the frames' stamps, being late, had seemed to move along is back with theirs."""
    right = drive_path(2.0).t_ns[:4]
    found = Detections(
        frame=np.arange(4), t_ns=right + 3 * 10**9, class_name=np.full(4, "stop", object),
        box=np.ones((4, 4)), score=np.ones(4), track=np.zeros(4, np.int64), camera="front",
    )  # fmt: skip

    def late(path: Trajectory, seen: Detections, *_: object) -> np.ndarray:
        return np.where(seen.t_ns > right[-1], "moving", "").astype(object)

    monkeypatch.setattr(camera_explanation, "no_signs", late)
    view = camera()
    stated = camera_explanation.Trial(
        [found], {"front": view}, GeolocationRules(), [late(winding, found)]
    )
    assert stated.rows("front").tolist() == []
    one = Hypothesis("late", replace(found, t_ns=right), view)
    assert stated.assuming("front", one, winding).rows("front").tolist() == [0, 1, 2, 3]


@pytest.mark.slow
def test_boxes_of_another_drive_make_no_sure_signs(winding) -> None:
    view = camera(mount_sd=np.radians(0.5), time_offset_sd=0.02)
    found, _ = boxes(winding, roadside(winding, every_s=2.0), view, np.random.default_rng(1))
    result = locate_signs(drive_path(60.0), [found], {"front": view})
    assert any("was not found" in text for text in result.warnings)
    seen = [sign for sign in result.signs if sign.n_views > 1]
    assert seen
    assert all(sign.status == "doubtful" for sign in seen)
    assert min(np.sqrt(np.trace(sign.cov_enu[:2, :2])) for sign in seen) > 3.0


def test_few_boxes_leave_the_camera_alone(winding) -> None:
    told = camera(mount_sd=np.radians(4.0), time_offset_sd=0.15)
    found, _ = boxes(winding, roadside(winding, every_s=50.0), told, np.random.default_rng(0))
    few = Detections(
        *(
            getattr(found, name)[:5]
            for name in ("frame", "t_ns", "class_name", "box", "score", "track")
        )
    )
    assert first_correction(winding, few, told, map_origin(winding), 0.0015) is None


@pytest.mark.slow
def test_boxes_that_are_not_seen_again_are_no_signs(winding) -> None:
    view = camera()
    rng = np.random.default_rng(3)
    scene = roadside(winding, every_s=3.0)
    found, _ = boxes(winding, scene, view, rng)
    middle = rng.uniform([200, 150], [1080, 500], (60, 2))
    half = rng.uniform(10, 30, (60, 1))
    at = rng.integers(0, int(found.frame.max()), 60)
    stamp = np.interp(at, found.frame, found.t_ns - found.t_ns[0]) + found.t_ns[0]
    stamp = np.array(
        [
            found.t_ns[found.frame == f][0] if (found.frame == f).any() else t
            for f, t in zip(at, stamp, strict=True)
        ],
        np.int64,
    )
    order = np.argsort(np.concatenate([found.frame, at]), kind="stable")
    mixed = Detections(
        frame=np.concatenate([found.frame, at])[order],
        t_ns=np.concatenate([found.t_ns, stamp])[order],
        class_name=np.concatenate([found.class_name, np.full(60, "ghost", np.object_)])[order],
        box=np.vstack([found.box, np.hstack([middle - half, middle + half])])[order],
        score=np.concatenate([found.score, np.full(60, 0.6)])[order],
        track=np.full(len(order), -1, np.int64),
    )
    result = locate_signs(winding, [mixed], {"front": view})
    ghosts = sum(sign.class_name == "ghost" for sign in result.signs)
    assert ghosts <= 6
    assert (result.observations.note == "unconfirmed").sum() > 40
    assert any("not seen again" in text for text in result.warnings)


def test_signs_on_a_post_share_a_support() -> None:
    place = np.array(
        [[0, 0, -2.0], [0.2, 0.1, -3.0], [1.5, 0, -2.0], [30, 0, -6.0], [30, 5, -6.0]], float
    )
    own = np.full(5, 0.01)
    over = [False, False, False, True, True]
    assert support_numbers(place, own, over) == [0, 0, 1, 2, 2]
    assert support_numbers(np.zeros((0, 3)), np.zeros(0), []) == []
