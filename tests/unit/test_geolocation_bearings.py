"""Objects from finished sightings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from geolocation_scene import ORIGIN
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.earth import from_local_ned, local_ned
from automap.errors import InputError
from automap.geolocation.bearings import BearingRules, locate_from_bearings
from automap.geolocation.depth_scale import fit_depth_scale
from automap.geolocation.limits import CONFIDENCE_SD_M, VIEW_EVIDENCE
from automap.io.bearings_csv import read_bearings
from automap.records import Bearings


def sightings(
    objects: np.ndarray,
    cameras: np.ndarray,
    rng: np.random.Generator,
    with_depth: bool = True,
    max_range_m: float = 30.0,
    bearing_sd_deg: float = 1.0,
) -> tuple[Bearings, np.ndarray]:
    """All sightings of objects [m, 2] from cameras [n, 2] within range, and their objects."""
    offset = objects[None] - cameras[:, None]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    camera, thing = np.nonzero((distance < max_range_m) & (distance > 3.0))
    n = len(camera)
    bearing = np.arctan2(offset[camera, thing, 1], offset[camera, thing, 0])
    place = np.column_stack([cameras[camera], np.zeros(n)])
    lat, lon, _ = from_local_ned(place.reshape(-1, 3), (*ORIGIN[:2], 0.0))
    depth = distance[camera, thing] * np.exp(rng.normal(0, 0.15, n))
    return (
        Bearings(
            lat_rad=np.reshape(lat, n),
            lon_rad=np.reshape(lon, n),
            bearing_rad=bearing + np.radians(rng.normal(0, bearing_sd_deg, n)),
            depth_m=depth if with_depth else np.full(n, np.nan),
            class_name=np.full(n, "lamp", np.object_),
            sd_rad=np.full(n, np.radians(max(bearing_sd_deg, 0.1))),
        ),
        thing,
    )


def places(signs: list) -> np.ndarray:
    ned = local_ned([s.lat_rad for s in signs], [s.lon_rad for s in signs], 0.0, (*ORIGIN[:2], 0.0))
    return np.asarray(ned).reshape(-1, 3)[:, :2]


@pytest.fixture(scope="module")
def street() -> tuple[np.ndarray, np.ndarray]:
    """Lamps on both sides of a street every 14 m, a camera position every 6 m."""
    along = np.arange(0.0, 140.0, 14.0)
    lamps = np.vstack(
        [
            np.column_stack([along, np.full(10, 7.0)]),
            np.column_stack([along + 5, np.full(10, -6.0)]),
        ]
    )
    cameras = np.column_stack([np.arange(-10.0, 150.0, 6.0), np.zeros(27)])
    return lamps, cameras


@pytest.mark.parametrize("n", [2, 3])
def test_confidence_falls_with_fewer_cameras_and_a_less_sure_place(n: int) -> None:
    """The chance that one camera at least is right, over the root of one and the mean variance in
    units of the place that halves it."""
    cameras = np.array([[-9.0, 0.0], [0.0, -2.0], [9.0, 1.0]])[:n]
    rays, _ = sightings(np.array([[1.0, 7.0]]), cameras, np.random.default_rng(4), False)
    signs, _ = locate_from_bearings(rays)
    variance = (signs[0].cov_enu[0, 0] + signs[0].cov_enu[1, 1]) / 2.0
    assert variance > 0.01
    wanted = (1.0 - (1.0 - VIEW_EVIDENCE) ** n) / np.sqrt(1.0 + variance / CONFIDENCE_SD_M**2)
    assert [s.confidence for s in signs] == pytest.approx([wanted])


def test_a_street_of_lamps(street) -> None:
    lamps, cameras = street
    rays, _ = sightings(lamps, cameras, np.random.default_rng(1))
    signs, index = locate_from_bearings(rays)
    assert len(signs) == len(lamps)
    error = np.linalg.norm(lamps[:, None] - places(signs)[None], axis=2).min(axis=1)
    assert error.max() < 1.5
    assert (index >= 0).mean() > 0.97
    for number, sign in enumerate(signs):
        assert (index[sign.detection_rows] == number).all()
        assert sign.class_name == "lamp"
        assert np.linalg.eigvalsh(sign.cov_enu[:2, :2])[0] > 0.0


def test_without_depth_the_crossings_alone_decide() -> None:
    rng = np.random.default_rng(2)
    lamps = np.array([[20.0, 9.0], [45.0, -8.0], [80.0, 10.0]])
    cameras = np.column_stack([np.arange(0.0, 100.0, 8.0), np.zeros(13)])
    rays, _ = sightings(lamps, cameras, rng, with_depth=False, bearing_sd_deg=0.5)
    signs, _ = locate_from_bearings(rays)
    error = np.linalg.norm(lamps[:, None] - places(signs)[None], axis=2).min(axis=1)
    assert error.max() < 1.5
    assert all(s.n_views >= 2 for s in signs)


def test_a_single_sighting_needs_a_depth() -> None:
    lamp, camera = np.array([[12.0, 5.0]]), np.array([[0.0, 0.0]])
    rng = np.random.default_rng(0)
    with_depth, _ = sightings(lamp, camera, rng)
    assert locate_from_bearings(with_depth)[0] == []
    alone = BearingRules(single=True)
    (sign,), index = locate_from_bearings(with_depth, alone)
    assert sign.status == "single_view"
    assert index.tolist() == [0]
    without, _ = sightings(lamp, camera, rng, with_depth=False)
    signs, index = locate_from_bearings(without, alone)
    assert signs == []
    assert index.tolist() == [-1]


def test_one_camera_sees_an_object_once() -> None:
    lamps = np.array([[20.0, 4.0], [20.0, 7.0]])
    cameras = np.array([[0.0, 0.0], [8.0, -6.0], [34.0, 1.0]])
    rays, thing = sightings(lamps, cameras, np.random.default_rng(3), bearing_sd_deg=0.5)
    signs, index = locate_from_bearings(rays, BearingRules(position_sd_m=0.3))
    assert len(signs) == 2
    for k in range(2):
        assert len(np.unique(index[thing == k])) == 1


@settings(max_examples=15)
@given(st.integers(0, 2**31), st.integers(0, 12))
def test_whatever_comes_in_is_accounted_for(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    rays = Bearings(
        lat_rad=-0.6 + rng.normal(0, 2e-6, n),
        lon_rad=2.6 + rng.normal(0, 2e-6, n),
        bearing_rad=rng.uniform(-7, 7, n),
        depth_m=np.where(rng.random(n) < 0.5, rng.uniform(0.1, 100.0, n), np.nan),
        class_name=np.full(n, "", np.object_),
        sd_rad=np.full(n, np.nan),
    )
    signs, index = locate_from_bearings(rays)
    assert len(index) == n
    assert index.max(initial=-1) < len(signs)
    assert sum(s.n_views for s in signs) == int((index >= 0).sum())
    for sign in signs:
        assert np.isfinite([sign.lat_rad, sign.lon_rad, sign.confidence]).all()


def test_reading_sightings(tmp_path: Path) -> None:
    path = tmp_path / "bearings.csv"
    path.write_text(
        "bearing_deg,lat_deg,lon_deg,depth_m,class\n"
        "90,51.5,-0.1,7.5,lamp\n180,51.5,-0.1,0,\n10,95,0,1,lamp\n"
    )
    rays, sentences = read_bearings(path)
    assert len(rays) == 2
    assert np.degrees(rays.bearing_rad) == pytest.approx([90, 180])
    assert np.isnan(rays.depth_m[1])
    assert rays.class_name.tolist() == ["lamp", ""]
    assert "1 of 3 sightings" in sentences[0]
    assert "line 4" in sentences[0]


@pytest.mark.parametrize("text", ["", "lat,lon\n1,2\n", "lat_deg,lon_deg,bearing_deg\n151,2,3\n"])
def test_unusable_sightings_are_one_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bearings.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"bearings\.csv"):
        read_bearings(path)


def test_depths_that_are_all_too_short_are_found_out(street) -> None:
    lamps, cameras = street
    rays, _ = sightings(lamps, cameras, np.random.default_rng(5), max_range_m=20.0)
    short = replace(rays, depth_m=np.maximum(rays.depth_m - 3.0, 0.5) / 1.2)
    signs, _ = locate_from_bearings(short)
    error = np.linalg.norm(lamps[:, None] - places(signs)[None], axis=2).min(axis=1)
    assert len(signs) == len(lamps)
    assert error.max() < 2.0


def test_offset_and_scale_of_depths() -> None:
    rng = np.random.default_rng(6)
    distance = rng.uniform(4.0, 25.0, 400)
    measured = (distance - 2.0) / 1.3 * np.exp(rng.normal(0.0, 0.2, 400))
    wide = BearingRules(depth_offset_sd_m=3.0, depth_scale_log_sd=0.5)
    scale = fit_depth_scale(measured, distance, np.full(400, 0.2), wide)
    expected = 2.0 + 1.3 * np.array([5.0, 12.0])
    assert scale.apply(np.array([5.0, 12.0])) == pytest.approx(expected, rel=0.1)
    none = fit_depth_scale(np.zeros(0), np.zeros(0), np.zeros(0), wide)
    assert (none.offset_m, none.scale) == (0.0, 1.0)
