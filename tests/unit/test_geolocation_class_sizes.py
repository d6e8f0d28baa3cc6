"""What the class of a sign, and the other signs of its class, tell of its size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from geolocation_scene import ORIGIN, Scene, boxes, camera, drive_path, roadside

from automap.earth import local_ned
from automap.geolocation.class_sizes import sizes_of_others, usual_sizes
from automap.geolocation.landmark import SizePrior, fit_landmark
from automap.geolocation.limits import USUAL_LOG_SD
from automap.geolocation.locate import locate_signs
from automap.geolocation.pass_errors import solve_with_pass_errors
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.views import MeasurementNoise, build_views
from automap.records import Detections

STOP = "regulatory--stop--g1"
YIELD = "regulatory--yield--g1"


def rows_of(found: Detections, rows: np.ndarray) -> Detections:
    names = ("frame", "t_ns", "class_name", "box", "score", "track")
    return replace(found, **{name: getattr(found, name)[rows] for name in names})


def test_known_classes_have_their_height_and_others_the_general_prior() -> None:
    prior = SizePrior(by_class=usual_sizes([STOP, YIELD, "kitti-ts-4"]))
    assert prior.of([STOP]).size_m == 0.75
    # a triangle 0.9 m wide is less tall
    assert abs(prior.of([YIELD]).size_m - 0.78) < 0.01
    assert prior.of([STOP]).log_sd == USUAL_LOG_SD
    assert prior.of(["kitti-ts-4"]) is prior
    # a face of which only colour and shape are known is as tall as most of that look
    shape = usual_sizes(["warning--unknown-yellow-diamond", "information--unknown-other"])
    assert shape["warning--unknown-yellow-diamond"].size_m == 0.75
    assert shape["warning--unknown-yellow-diamond"].log_sd > USUAL_LOG_SD
    assert "information--unknown-other" not in shape
    # one wrong name among the views does not decide
    assert prior.of([YIELD, STOP, STOP]).size_m == 0.75


def test_a_known_class_places_a_sign_that_was_seen_once() -> None:
    path = drive_path()
    scene = roadside(path)
    octagons = Scene(scene.position, np.full(len(scene.size_m), 1.2), (STOP,) * len(scene.size_m))
    found, owner = boxes(path, octagons, camera(), np.random.default_rng(3))
    single = rows_of(found, np.flatnonzero(owner == owner[0])[-1:])
    large = SizePrior(by_class={STOP: SizePrior(1.2, 0.05)})
    for size, limit in ((SizePrior(), (1.0, 9.0)), (large, (0.0, 1.0))):
        (sign,) = locate_signs(
            path, [single], {"front": camera()}, GeolocationRules(size=size)
        ).signs
        where = (np.array([sign.lat_rad]), np.array([sign.lon_rad]), np.array([sign.height_m]))
        place = local_ned(*where, ORIGIN)[0, :2]
        error = np.linalg.norm(place - octagons.position[owner[0], :2])
        assert limit[0] < error < limit[1]


def settled(size_m: np.ndarray, names: tuple[str, ...]):
    path = drive_path(turn_rate=0.02)
    scene = roadside(path)
    n = len(scene.size_m)
    world = Scene(scene.position, np.resize(size_m, n), tuple(np.resize(names, n).tolist()))
    found, owner = boxes(path, world, camera(), np.random.default_rng(8))
    views = build_views(path, [found], {"front": camera()}, MeasurementNoise())
    prior = SizePrior()
    shown = owner[views.row]
    marks = [fit_landmark(views, np.flatnonzero(shown == k), prior) for k in np.unique(shown)]
    return views, [solve_with_pass_errors(views, mark, prior) for mark in marks], prior


def test_the_other_signs_of_a_class_tell_the_size() -> None:
    views, marks, prior = settled(np.array([0.45, 0.9]), ("small", "large"))
    sizes = sizes_of_others(views, marks, prior)
    for mark, size in zip(marks, sizes, strict=True):
        name = views.class_name[mark.rows[0]]
        assert abs(np.log(size.size_m / {"small": 0.45, "large": 0.9}[name])) < 0.1
        assert size.log_sd < 0.5 * prior.log_sd


def test_a_sign_alone_of_its_class_keeps_the_prior() -> None:
    views, marks, prior = settled(np.array([0.7]), tuple(f"kind-{k}" for k in range(20)))
    assert sizes_of_others(views, marks, prior) == [prior] * len(marks)


def test_a_class_of_two_sizes_is_less_sure() -> None:
    alike = sizes_of_others(*settled(np.array([0.7]), ("one",)))
    mixed = sizes_of_others(*settled(np.array([0.5, 1.0]), ("one",)))
    assert min(s.log_sd for s in mixed) > 1.5 * max(s.log_sd for s in alike)


def test_a_size_that_bearings_refute_gives_way() -> None:
    """A sign twice as large as expected stands where its bearings cross, with heavy tails."""
    path = drive_path(turn_rate=0.02)
    scene = roadside(path)
    found, owner = boxes(path, scene, camera(), np.random.default_rng(8))
    views = build_views(path, [found], {"front": camera()}, MeasurementNoise())
    rows = np.flatnonzero(owner[views.row] == owner[len(owner) // 2])
    wrong = fit_landmark(views, rows, SizePrior(0.3, 0.05))
    right = fit_landmark(views, rows, SizePrior(0.75, 0.4))
    assert abs(np.log(wrong.size_m / right.size_m)) < 0.1
