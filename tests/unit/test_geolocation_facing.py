"""Which way signs face, against faces whose boxes come from points on their rims."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from geolocation_scene import ORIGIN, Scene, boxes, camera, drive_path, roadside

from automap.earth import local_ned
from automap.export.osm_tags import direction_tag
from automap.frames import rpy_to_matrix, wrap_pi
from automap.gates import sigmas
from automap.geolocation import limits
from automap.geolocation.facing import (
    Faces,
    _believe,
    _observed,
    _Seen,
    _summary,
    expected_aspect,
    find_facings,
)
from automap.geolocation.landmark import view_sd
from automap.geolocation.locate import locate_signs
from automap.geolocation.path_relation import make_path
from automap.geolocation.views import MeasurementNoise, build_views
from automap.simulation.boxes import face_box, face_outline
from automap.simulation.scene import SceneSign
from tests.benchmarks.geolocation_facing import ONE, errors

SHAPES = {
    "regulatory--no-entry--g1": "circle",
    "regulatory--stop--g1": "octagon",
    "regulatory--yield--g1": "triangle-down",
    "warning--roundabout--g2": "diamond",
    "information--parking--g1": "square",
}


@pytest.mark.parametrize("name", sorted(SHAPES))
def test_the_aspect_of_a_small_face_is_that_of_its_projected_outline(name: str) -> None:
    path = drive_path(duration_s=14.0, turn_rate=0.0)
    view = camera()
    found, owner = boxes(path, roadside(path), view, np.random.default_rng(0), noise_px=0.0)
    place = roadside(path).position[owner[0]]
    rows = np.flatnonzero(owner == owner[0])
    views = build_views(path, [found], {"front": view}, MeasurementNoise())
    views = replace(views, origin=ORIGIN)
    at = [int(np.argmin(np.abs(path.t_ns - t))) for t in found.t_ns[rows]]
    body = local_ned(path.lat_rad[at], path.lon_rad[at], path.height_m[at], ORIGIN)
    C_n_b = rpy_to_matrix(path.rpy[at])
    C_cam_n = np.swapaxes(C_n_b @ rpy_to_matrix(view.mount_rpy), 1, 2)
    ray = np.einsum("nij,nj->ni", C_cam_n, place - body - C_n_b @ view.lever_arm_m)
    normals = np.pi + 0.7 + np.radians([-40.0, -15.0, 0.0, 20.0, 50.0])
    told = expected_aspect(views, np.flatnonzero(np.isin(views.row, rows)), normals, SHAPES[name])
    for k, normal in enumerate(normals):
        sign = SceneSign(name, place, place, float(normal), 0.05, 1.0)
        corners = np.einsum("nij,kj->nki", C_cam_n, face_outline(sign))
        box = face_box(view, ray, corners)
        shown = np.log((box[:, 2] - box[:, 0]) / (box[:, 3] - box[:, 1]))
        np.testing.assert_allclose(told[:, k], shown, atol=0.012)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [(100,), (101, 102)])
def test_turned_signs_face_where_they_do_within_their_sigmas(seeds: tuple[int, ...]) -> None:
    d = replace(ONE, turned="uniform", turned_deg=15.0, duration_s=300.0)
    off, sd = np.concatenate([errors(d, seed) for seed in seeds]).T
    assert len(off) > 45 * len(seeds)
    assert np.median(np.abs(off)) < 3.0
    inside = np.mean(np.abs(off) < sigmas(0.05) * sd)
    # three sigmas of the share about 95.5 %
    assert inside > 0.955 - 3.0 * np.sqrt(0.955 * 0.045 / len(off))
    assert np.median(sd) < 6.0


@pytest.mark.slow
def test_signs_seen_from_afar_alone_get_the_roads_direction_with_its_sigma() -> None:
    path = drive_path(duration_s=30.0, turn_rate=0.0)
    scene = roadside(path)
    found, _ = boxes(path, scene, camera(), np.random.default_rng(3), range_m=(32.0, 45.0))
    result = locate_signs(path, [found], {"front": camera()})
    assert len(result.signs) >= 4
    for sign in result.signs:
        off = np.degrees((sign.facing_rad - 0.7 - 2.0 * np.pi) % (2.0 * np.pi) - np.pi)
        assert abs(off) < 2.0 * np.degrees(sign.facing_sd_rad)
        assert sign.facing_sd_rad > 0.8 * result.faces.turned_sd
    assert result.faces.turned_sd > 0.5 * limits.TURNED_SD


def test_openstreetmap_gets_directions_that_are_known_to_a_cardinal_point_of_eight() -> None:
    assert direction_tag(359.7, 4.0) == {"direction": "0"}
    assert direction_tag(90.0, 12.0) == {}
    assert direction_tag(90.0, float("nan")) == {}
    assert direction_tag(float("nan"), 4.0) == {}


def test_a_box_that_is_hardly_believed_tells_less_of_the_face() -> None:
    """A log aspect errs by its height's share and its width's; a weight is a variance's."""
    path = drive_path(duration_s=14.0, turn_rate=0.0)
    view = camera()
    found, owner = boxes(path, roadside(path), view, np.random.default_rng(0))
    views = build_views(path, [found], {"front": view}, MeasurementNoise())
    # narrow and broad ones in turn
    views = replace(views, log_aspect=np.resize([-0.4, 0.3, -0.1], len(views)))
    rows = np.flatnonzero(owner[views.row] == owner[0])
    weight = np.linspace(0.1, 1.0, len(rows))
    sighting: Any = SimpleNamespace(
        landmark=SimpleNamespace(rows=rows, weight=weight),
        facing=np.array([1.0, 0.0, 0.0]),
        position=np.array([20.0, 5.0, 0.0]),
        covariance=0.1 * np.eye(3),
    )
    seen = _observed(views, [sighting], make_path(path, views.origin))
    aspect = np.exp(views.log_aspect[rows])
    height_sd = view_sd(views, rows)[:, 2]
    wanted = height_sd**2 * (1.0 + np.maximum(1.0 / aspect, 1.0) ** 2) / weight
    assert seen.sd**2 == pytest.approx(wanted)


def _slant(lateral_m: float, normal_rad: float, place_sd_m: float) -> tuple[float, float]:
    """Direction and sigma, rad, found of a face beside a straight drive to 0.7 rad, seen in
    pictures without scatter from 45 m to 10 m before it is passed."""
    path = drive_path(duration_s=14.0, turn_rate=0.0)
    view = camera()
    along = 12.0 * 10.0
    place = along * np.array([np.cos(0.7), np.sin(0.7)])
    place += lateral_m * np.array([-np.sin(0.7), np.cos(0.7)])
    scene = Scene(np.array([[*place, -2.2]]), np.array([0.75]), ("regulatory--no-entry--g1",))
    found, _ = boxes(path, scene, view, np.random.default_rng(0), noise_px=0.0)
    views = build_views(path, [found], {"front": view}, MeasurementNoise())
    rows = np.arange(len(views))
    shown = expected_aspect(views, rows, np.array([normal_rad]), "circle")[:, 0]
    views = replace(views, log_aspect=shown)
    towards = (views.centre[:, :2] - place).mean(axis=0)
    sighting: Any = SimpleNamespace(
        landmark=SimpleNamespace(rows=rows, weight=np.ones(len(rows))),
        facing=towards / np.linalg.norm(towards),
        position=scene.position[0],
        covariance=place_sd_m**2 * np.eye(3),
    )
    (facing,), _ = find_facings(views, [[sighting]], make_path(path, views.origin))
    return facing.rad, facing.sd_rad


@pytest.mark.parametrize("lateral_m", [-24.0, 24.0])
@pytest.mark.parametrize("place_sd_m", [0.3, 8.0])
def test_a_face_of_a_crossing_street_is_not_taken_for_its_mirror_image(
    lateral_m: float, place_sd_m: float
) -> None:
    normal = 0.7 + np.pi + np.copysign(np.pi / 2.0, lateral_m)
    found, sd = _slant(lateral_m, normal, place_sd_m)
    assert abs(wrap_pi(found - normal)) < 2.0 * sd


def test_a_face_beside_the_road_is_still_told_by_the_road() -> None:
    normal = 0.7 + np.pi + np.radians(8.0)
    found, sd = _slant(-4.5, normal, 0.3)
    assert abs(wrap_pi(found - normal)) < 2.0 * sd
    assert sd < np.radians(12.0)


def _believed(least: float, told: float, draws: int = 150) -> float:
    """Mean probability, over draws, of the right one of two mirror images of a face 62 deg off the
    line of sight that a car comes nearer to: a detector finds boxes of more than the log width
    ``least`` alone, and the estimator takes it for one of ``told``."""
    rng, sd = np.random.default_rng(3), 0.2
    grid, turn = np.radians(np.arange(-90.0, 90.5, 1.0)), np.radians(np.linspace(-5.0, 5.0, 6))
    height = np.linspace(0.0, 0.4, 6)
    expected = np.log(np.maximum(np.cos(grid - turn[:, None]), 0.02))
    right: list[float] = []
    while len(right) < draws:
        measured = expected[:, 152] + sd * rng.standard_normal(6)
        kept = measured + height > least
        n = int(kept.sum())
        if n < 2:
            continue
        one = _Seen(
            grid=grid, centres=np.array([np.pi]), beside=np.zeros(1), measured=measured[kept],
            expected=expected[kept], sd=np.full(n, sd), crowd=np.ones(n),
            columns=np.column_stack([np.ones(n), np.full(n, 0.02)]),
            least=(told - height)[kept], octave=np.zeros(n, np.int64),
            octaves=np.zeros(1, np.int64), sure=True, yaw_sd=0.0,
        )  # fmt: skip
        right.append(float(_believe(one, Faces()).normal[grid > 0.0].sum()))
    return float(np.mean(right))


def test_boxes_too_narrow_to_be_found_do_not_speak_for_the_mirror_image() -> None:
    none, cut = -9.0, float(np.log(0.5))
    every, allowed, taken = _believed(none, none), _believed(cut, cut), _believed(cut, none)
    assert taken + 0.05 < allowed < every


def test_of_two_mirror_images_the_likelier_is_stated_and_the_sigma_reaches_the_other() -> None:
    grid = np.radians(np.arange(-90.0, 90.5, 1.0))
    for share in (0.6, 0.9):
        normal = share * np.exp(-0.5 * ((grid - 1.0) / 0.05) ** 2)
        normal += (1.0 - share) * np.exp(-0.5 * ((grid + 1.0) / 0.05) ** 2)
        belief: Any = SimpleNamespace(normal=normal / normal.sum())
        found = _summary(cast(_Seen, SimpleNamespace(grid=grid, yaw_sd=0.0)), belief)
        assert abs(found.rad - 1.0) < 0.1
        assert found.rad - 1.96 * found.sd_rad < -0.9
