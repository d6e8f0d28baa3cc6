"""Signs on lorries: what moves along with the camera is no sign of the road."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from geolocation_scene import ORIGIN, boxes, camera, drive_path, roadside

from automap.earth import local_ned
from automap.effects.lens import project
from automap.frames import rpy_to_matrix
from automap.geolocation import carriers, limits
from automap.geolocation.landmark import SizePrior
from automap.geolocation.locate import locate_signs
from automap.geolocation.result import LEFT_OUT
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.views import MeasurementNoise, build_views
from automap.records import (
    UNKNOWN_FOCAL_SD,
    Camera,
    Detections,
    FloatArray,
    IntArray,
    Trajectory,
)
from tests.slow_cases import others_slow

SPEED = 12.0
NARROW = MeasurementNoise(0.7, 0.02, 0.0008)
"""Of a detector whose boxes were measured to be good."""


def carried(
    path: Trajectory, view: Camera, ahead_m: float, speed: float, seconds: float
) -> Detections:
    """Boxes of a sign, 0.75 m high, that goes along the path from ``ahead_m`` on."""
    rng = np.random.default_rng(4)
    here = local_ned(path.lat_rad, path.lon_rad, path.height_m, ORIGIN)
    way = np.arange(len(path)) * 0.01 * SPEED
    rows, box = [], []
    for row in range(1500, 1500 + int(seconds * 100), 20):
        along = way[1500] + ahead_m + speed * (row - 1500) * 0.01
        place: FloatArray = np.array([np.interp(along, way, here[:, k]) for k in range(3)])
        C = rpy_to_matrix(path.rpy[row])
        centre = here[row] + C @ view.lever_arm_m
        q = (C @ rpy_to_matrix(view.mount_rpy)).T @ (place - [0.0, 0.0, 1.5] - centre)
        if not 5.0 < q[0] < 60.0:
            continue
        x, y = project(view, q[None])[0] + rng.normal(0.0, 1.0, 2)
        half = 0.5 * view.matrix[0, 0] * 0.75 / q[0] * (1.0 + rng.normal(0.0, 0.02))
        rows.append(row)
        box.append([x - half, y - half, x + half, y + half])
    return Detections(
        frame=np.array(rows, np.int64) // 20,
        t_ns=path.t_ns[rows],
        class_name=np.full(len(rows), "carried", np.object_),
        box=np.array(box),
        score=np.full(len(rows), 0.9),
        track=np.full(len(rows), 999, np.int64),
    )


def together(one: Detections, other: Detections) -> Detections:
    names = ("frame", "t_ns", "class_name", "box", "score", "track")
    whole = {n: np.concatenate([getattr(one, n), getattr(other, n)]) for n in names}
    order = np.argsort(whole["frame"], kind="stable")
    return Detections(**{n: values[order] for n, values in whole.items()})


@pytest.mark.parametrize("turn_rate", [0.0, pytest.param(0.05, marks=pytest.mark.slow)])
@pytest.mark.parametrize("speed", others_slow([SPEED, 0.0, SPEED + 1.0]))
def test_a_sign_on_a_lorry_ahead_is_left_out_and_all_that_stand_are_kept(
    turn_rate: float, speed: float
) -> None:
    path = drive_path(40.0, SPEED, turn_rate)
    found, owner = boxes(path, roadside(path), camera(), np.random.default_rng(2))
    found = Detections(
        found.frame, found.t_ns, found.class_name, found.box, found.score, owner.astype(np.int64)
    )
    own = carried(path, camera(), 20.0 if speed else 44.0, speed, 15.0)
    both = together(found, own)
    result = locate_signs(path, [both], {"front": camera()})
    assert len([s for s in result.signs if s.class_name != "carried"]) == len(np.unique(owner))
    mine = [s for s in result.signs if s.class_name == "carried"]
    notes = result.observations.note[both.class_name == "carried"]
    if speed:
        assert not mine
        # one that keeps its distance keeps its place in the picture, too
        assert np.isin(notes, ("moving", "fixed")).mean() > 0.8
        assert any("lorry" in text for text in result.warnings)
    else:
        assert len(mine) == 1
        assert not (result.observations.note == "moving").any()


@pytest.mark.slow
def test_a_lorry_that_is_followed_in_pieces_hides_no_signs_and_shows_no_false_ones() -> None:
    """From its large boxes it was concluded that signs are found when they are as large, so that
    hardly a frame should have shown any again: 9 signs were lost here, and false boxes kept."""
    path = drive_path(40.0, SPEED, 0.0)
    found, owner = boxes(path, roadside(path), camera(), np.random.default_rng(2), interval_s=0.1)
    ahead = carried(path, camera(), 9.0, SPEED + 0.2, 20.0)
    pieces = ahead.track + np.arange(len(ahead)) // 10
    ahead = replace(ahead, frame=2 * ahead.frame, track=pieces)
    rng, n = np.random.default_rng(3), 40
    rows = np.sort(rng.choice(np.arange(200, 3800, 10), n, replace=False))
    corner = np.column_stack([rng.uniform(100, 1100, n), rng.uniform(200, 500, n)])
    false = Detections(
        rows // 10, path.t_ns[rows], np.full(n, "false", np.object_),
        np.hstack([corner, corner + 20.0]), np.full(n, 0.7), 5000 + np.arange(n),
    )  # fmt: skip
    signs = replace(found, track=owner.astype(np.int64))
    result = locate_signs(path, [together(together(signs, ahead), false)], {"front": camera()})
    of = [s.class_name for s in result.signs]
    assert sum(name.startswith("sign") for name in of) == len(np.unique(owner)) == 9
    assert of.count("false") <= 1


@pytest.mark.parametrize("turn_rate", [0.0, 0.02])
def test_a_false_box_ahead_of_a_track_makes_no_sign_move(turn_rate: float) -> None:
    path = drive_path(40.0, SPEED, turn_rate)
    found, owner = boxes(path, roadside(path), camera(), np.random.default_rng(2), interval_s=0.1)
    for sign in np.unique(owner):
        rows = np.flatnonzero(owner == sign)[:18]
        # a second and a half before, to the left, and larger
        row = found.t_ns[rows[0]] - 1_500_000_000
        at = np.searchsorted(path.t_ns, row)
        if at == 0:
            continue
        own = {k: v[rows] for k, v in vars(found).items() if isinstance(v, np.ndarray)}
        first = {k: v[:1] for k, v in own.items()} | {
            "frame": own["frame"][:1] - 15,
            "t_ns": path.t_ns[[at]],
            "box": np.array([[430.0, 460.0, 470.0, 500.0]]),
        }
        track = replace(found, **{k: np.concatenate([first[k], own[k]]) for k in own})
        track = replace(track, track=np.full(len(track), 7))
        views = build_views(path, [track], {"front": camera()}, NARROW)
        assert not carriers.moves_along(views, np.arange(len(views)), SizePrior())


def test_a_wait_in_sight_of_a_sign_makes_it_no_lorrys() -> None:
    """The car stands for 40 s, 12 m before a sign, and its path sinks by half a metre meanwhile."""
    moving = drive_path(30.0, SPEED, 0.0)
    stop, waits = 1300, 4000
    at = np.concatenate([np.arange(stop), np.full(waits, stop), np.arange(stop, len(moving))])
    held = {k: v[at] for k, v in vars(moving).items()}
    since = 0.01 * np.arange(len(at))
    held |= {"t_ns": (1e12 + since * 1e9).astype(np.int64), "gps_s": 1.4e9 + since}
    held["vel_ned"][stop : stop + waits] = 0.0
    held["sd_vel_ned"][stop : stop + waits] = 0.005
    true = Trajectory(**held)
    found, owner = boxes(true, roadside(moving), camera(), np.random.default_rng(2), interval_s=0.1)
    sunk = np.interp(since, [13.0, 53.0], [0.0, -0.5])
    views = build_views(
        replace(true, height_m=true.height_m + sunk), [found], {"front": camera()}, NARROW
    )
    seen, number = np.bincount(owner), owner[views.row]
    assert seen.max() > 300
    for sign in np.flatnonzero(seen > 10):
        assert not carriers.moves_along(views, np.flatnonzero(number == sign), SizePrior())


def test_many_boxes_from_few_places_tell_no_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    path = drive_path(20.0, SPEED, 0.0)
    found, owner = boxes(path, roadside(path), camera(), np.random.default_rng(2), interval_s=0.1)
    views = build_views(path, [found], {"front": camera()}, NARROW)
    rows = np.flatnonzero(owner[views.row] == 0)
    asked: list[int] = []
    monkeypatch.setattr(carriers, "fit_landmark", lambda *args: asked.append(1))
    monkeypatch.setattr(carriers, "places_apart", lambda views, rows: rows[:3])
    assert not carriers.moves_along(views, rows, SizePrior())
    assert not asked


def jam(path: Trajectory, speed: float) -> Detections:
    """Signs by the road, and one on a lorry ahead for 20 s."""
    found, owner = boxes(path, roadside(path), camera(), np.random.default_rng(2))
    found = replace(found, track=owner.astype(np.int64))
    return together(found, carried(path, camera(), 20.0, speed, 20.0))


@pytest.mark.parametrize("log_scale", others_slow([-0.25, 0.15]))
def test_a_focal_length_that_nobody_knows_moves_no_sign_along(log_scale: float) -> None:
    """Half a step of those that are tried from the true one, on a bend of 240 m radius."""
    path = drive_path(40.0, SPEED, 0.05)
    rng = np.random.default_rng(2)
    found, owner = boxes(path, roadside(path, 8.0), camera(), rng, range_m=(5.0, 115.0))
    found = replace(found, track=owner.astype(np.int64))
    both = together(found, carried(path, camera(), 20.0, SPEED + 0.5, 20.0))
    matrix = camera().matrix.copy()
    matrix[[0, 1], [0, 1]] *= np.exp(log_scale)
    assumed = replace(camera(), matrix=matrix, focal_sd=UNKNOWN_FOCAL_SD)
    far = carriers.far_carried(path, both, assumed, GeolocationRules())
    assert far[both.track == 999].mean() > 0.95
    assert not far[both.track != 999].any()


@pytest.mark.slow
def test_what_is_followed_further_than_signs_are_seen_is_left_out_before_anything_is_fitted() -> (
    None
):
    path = drive_path(40.0, SPEED, 0.02)
    both = jam(path, SPEED + 0.5)
    rules = GeolocationRules()
    far = carriers.far_carried(path, both, camera(), rules)
    assert far[both.track == 999].mean() > 0.95
    assert not far[both.track != 999].any()
    # a camera that is turned moves no sign along
    turned = replace(
        camera(), mount_rpy=camera().mount_rpy + np.radians([0.0, 2.0, -3.0]), mount_sd=0.05
    )
    far = carriers.far_carried(path, both, turned, rules)
    assert far[both.track == 999].mean() > 0.95
    assert not far[both.track != 999].any()
    # nor are signs and a lorry that a bad tracker gives one number
    mixed = replace(both, track=both.track % 2)
    assert not carriers.far_carried(path, mixed, camera(), rules).any()
    result = locate_signs(path, [both], {"front": camera()})
    moving = int((result.observations.note == "moving").sum())
    assert moving == (both.track == 999).sum()
    told = [text for text in result.warnings if "move along" in text]
    assert told == [f"{moving} of {len(both)} detections {LEFT_OUT['moving']}; they were left out."]


def test_a_track_is_judged_by_its_own_boxes_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tracks of two cameras, mixed at random, against sets of camera and number."""
    rng = np.random.default_rng(3)
    camera_of, track = rng.integers(0, 2, 300), rng.integers(-1, 40, 300)
    asked: list[set[int]] = []

    def moves(_: object, rows: IntArray, prior: SizePrior) -> bool:
        asked.append(set(rows.tolist()))
        return camera_of[rows[0]] == 1

    class Many(SimpleNamespace):
        def __len__(self) -> int:
            return len(track)

    views = Many(camera=camera_of, track=track)
    monkeypatch.setattr(carriers, "moves_along", moves)
    carried_rows = carriers.carried_views(views, SizePrior())  # type: ignore[arg-type]
    sets: dict[tuple[int, int], set[int]] = {}
    for row in range(300):
        if track[row] >= 0:
            sets.setdefault((int(camera_of[row]), int(track[row])), set()).add(row)
    long = {key: rows for key, rows in sets.items() if len(rows) >= limits.CARRIER_VIEWS}
    assert 0 < len(long) < len(sets)
    assert sorted(map(sorted, asked)) == sorted(map(sorted, long.values()))
    wanted = {row for (camera, _), rows in long.items() if camera for row in rows}
    assert set(np.flatnonzero(carried_rows)) == wanted
