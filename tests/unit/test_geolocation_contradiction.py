"""Signs whose bearings and whose boxes' heights say different distances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from geolocation_scene import ORIGIN, Scene, boxes, camera, drive_path, roadside

from automap.earth import from_local_ned, local_ned
from automap.gates import OUTSIDE_95, gate
from automap.geolocation.contradiction import disagreement
from automap.geolocation.landmark import Landmark, SizePrior, fit_landmark
from automap.geolocation.locate import locate_signs
from automap.geolocation.pass_errors import solve_with_pass_errors
from automap.geolocation.result import GeolocationResult
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.views import MeasurementNoise, Views, build_views
from automap.records import Detections, Sign

SIZES = SizePrior(0.75, 0.1)


def scene(odd: int = -1, factor: float = 3.0) -> tuple[Scene, int]:
    """Signs of one size beside the road but for one, whose number comes back as well."""
    path = drive_path()
    alike = roadside(path)
    size = alike.size_m.copy()
    size[odd] *= factor if odd >= 0 else 1.0
    return Scene(alike.position, size, ("one-class",) * len(size)), odd


def rows_of(found: Detections, rows: np.ndarray) -> Detections:
    names = ("frame", "t_ns", "class_name", "box", "score", "track")
    return replace(found, **{name: getattr(found, name)[rows] for name in names})


def settled(world: Scene, seed: int) -> tuple[Views, list[Landmark]]:
    path = drive_path()
    found, owner = boxes(path, world, camera(), np.random.default_rng(seed))
    views = build_views(path, [found], {"front": camera()}, MeasurementNoise())
    shown = owner[views.row]
    marks = [fit_landmark(views, np.flatnonzero(shown == k), SIZES) for k in np.unique(shown)]
    return views, [solve_with_pass_errors(views, m, SIZES) for m in marks]


def test_signs_as_tall_as_expected_do_not_contradict_themselves() -> None:
    squares = []
    for seed in range(4):
        views, marks = settled(scene()[0], seed)
        found = [disagreement(views, mark, SIZES) for mark in marks]
        assert not any(f.contradictory for f in found)
        squares += [f.square for f in found]
    # the sigmas of both ways are no smaller than they differ by
    assert 0.0 < np.mean(squares) < 1.3


def located(factor: float, last: slice) -> tuple[GeolocationResult, Sign, Scene, Views]:
    """The signs of a street, the third of another size and seen in those of its boxes only."""
    world, odd = scene(2, factor)
    path = drive_path()
    found, owner = boxes(path, world, camera(), np.random.default_rng(5))
    its = np.flatnonzero(owner == odd)
    kept = np.setdiff1d(np.arange(len(owner)), np.setdiff1d(its, its[last]))
    found = rows_of(found, kept)
    result = locate_signs(
        *(path, [found], {"front": camera()}),
        # two boxes of thirty that were due are not asked whether they are a sign
        GeolocationRules(size=SIZES, estimate_camera=False, min_existence=0.0),
    )
    (sign,) = (
        s
        for s in result.signs
        if np.isin(s.detection_rows, np.flatnonzero(owner[kept] == odd)).all()
    )
    return result, sign, world, build_views(path, [found], {"front": camera()}, MeasurementNoise())


def test_bearings_and_heights_that_cannot_both_be_right_are_told_and_held() -> None:
    result, sign, world, views = located(2.0, slice(10, 12))
    assert sum("status contradictory" in sentence for sentence in result.warnings) == 1
    assert [s.id for s in result.signs if s.status == "contradictory"] == [sign.id]
    where = (np.array([sign.lat_rad]), np.array([sign.lon_rad]), np.array([sign.height_m]))
    place = local_ned(*where, ORIGIN)[0]
    last = np.flatnonzero(np.isin(views.row, sign.detection_rows))[-1:]
    near = local_ned(*from_local_ned(views.centre[last], views.origin), ORIGIN)[0]
    # by the heights it is half as far as it is: both places are inside
    for candidate in (world.position[2], near + (world.position[2] - near) / 2.0):
        error = (candidate - place)[[1, 0]]
        assert float(error @ np.linalg.solve(sign.cov_enu[:2, :2], error)) < gate(OUTSIDE_95, 2)


def test_a_sign_of_an_odd_size_whose_growth_confirms_its_bearings_is_no_contradiction() -> None:
    result, sign, world, _ = located(3.0, slice(None))
    assert sign.status == "ok"
    assert not any("contradictory" in sentence for sentence in result.warnings)
    assert abs(sign.size_m / world.size_m[2] - 1.0) < 0.1


def test_one_view_and_parallel_bearings_contradict_nothing() -> None:
    views, marks = settled(scene()[0], 1)
    alone = solve_with_pass_errors(views, fit_landmark(views, marks[0].rows[:1], SIZES), SIZES)
    assert disagreement(views, alone, SIZES).square == 0.0
    # at a standstill bearings have no distance, whatever the size
    still = replace(
        views, centre=np.broadcast_to(views.centre[marks[0].anchor], views.centre.shape)
    )
    mark = solve_with_pass_errors(still, fit_landmark(still, marks[0].rows[-3:], SIZES), SIZES)
    odd = SizePrior(SIZES.size_m * 3.0, SIZES.log_sd)
    assert not disagreement(still, mark, odd).contradictory
