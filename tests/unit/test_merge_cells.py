"""Merging by cells: the same map as in one piece, whatever the order, on the whole globe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from merge_scene import Scene, street_scene

from automap.earth import MEAN_RADIUS
from automap.mapping import cells
from automap.mapping.by_cells import associate_by_cells, joined_signs
from automap.mapping.cells import (
    LEVEL,
    beside,
    cell_named,
    cell_of,
    colour_of,
    meets,
    quadkey,
    squares,
)
from automap.mapping.merge import Merged, merge_drives
from automap.mapping.sightings import DriveSigns, stack_sightings
from tests.slow_cases import others_slow

POLE, TURN = np.pi / 2, np.pi


def moved(drive: DriveSigns, lat: float, lon: float) -> DriveSigns:
    """The drive of a made-up town, put down with its origin at another place of the globe."""
    from merge_scene import ORIGIN

    stretch = np.cos(ORIGIN[0]) / np.cos(lat)

    def turned(values: np.ndarray) -> np.ndarray:
        return np.mod(lon + stretch * (values - ORIGIN[1]) + np.pi, 2 * np.pi) - np.pi

    path = drive.path
    assert path is not None
    return replace(
        drive,
        lat_rad=drive.lat_rad - ORIGIN[0] + lat,
        lon_rad=turned(drive.lon_rad),
        path=replace(path, lat_rad=path.lat_rad - ORIGIN[0] + lat, lon_rad=turned(path.lon_rad)),
    )


def at_edge(scene: Scene, lon: float, level_lat: float = -0.6) -> list[DriveSigns]:
    """The street across an edge between two rows of cells, along the meridian ``lon``."""
    side = 1 << LEVEL
    row = int(cell_of(np.array([level_lat]), np.array([lon]))[0]) // side
    edge = float(np.arctan(np.sinh(np.pi * (1.0 - 2.0 * row / side))))
    half = 1000.0 / MEAN_RADIUS
    return [moved(drive, edge - half, lon) for drive in scene.drives]


@settings(max_examples=300)
@given(
    st.one_of(
        st.floats(-POLE, POLE),
        st.sampled_from([POLE, -POLE, 0.0, cells._END, -cells._END]),
        st.floats(1.484, 1.485),
    ),
    st.one_of(st.floats(-TURN, TURN), st.sampled_from([TURN, -TURN, 0.0])),
    st.floats(0.0, 2 * np.pi),
    st.floats(0.0, 399.0),
)
def test_what_is_within_the_margin_of_a_cell_touches_it(
    lat: float, lon: float, azimuth: float, distance_m: float
) -> None:
    """The cell of any place up to the margin away is among those touched: over the antimeridian,
    over the poles, over the end of the tiles."""
    d = distance_m / MEAN_RADIUS
    there = np.arcsin(
        np.clip(np.sin(lat) * np.cos(d) + np.cos(lat) * np.sin(d) * np.cos(azimuth), -1, 1)
    )
    aside = np.arctan2(
        np.sin(azimuth) * np.sin(d) * np.cos(lat), np.cos(d) - np.sin(lat) * np.sin(there)
    )
    around = squares(np.array([lat]), np.array([lon]), 400.0)
    home = int(cell_of(np.array([lat]), np.array([lon]))[0])
    assert meets(home, around).all()
    assert meets(int(cell_of(np.array([there]), np.array([lon + aside]))[0]), around).all()
    assert int((around.columns * around.rows)[0]) < 64


def test_cells_have_the_names_of_web_map_tiles() -> None:
    """The tile of Berlin's centre at level 14: x 8802, y 5373."""
    cell = int(cell_of(np.radians([52.5200]), np.radians([13.4050]))[0])
    assert cell == 5373 * (1 << 14) + 8802
    assert cell_named(quadkey(cell)) == cell
    assert len(quadkey(cell)) == LEVEL


def test_cells_that_touch_differ_in_colour() -> None:
    rng = np.random.default_rng(5)
    side = 1 << LEVEL
    y, x = rng.integers(0, side, 500), rng.integers(0, side, 500)
    y[:20], x[:40:2] = 0, 0
    for cell_y, cell_x in zip(y.tolist(), x.tolist(), strict=True):
        for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
            if cell_y + dy < side:
                beside = (cell_y + dy) * side + (cell_x + dx) % side
                assert colour_of(cell_y * side + cell_x) != colour_of(beside)


def same_groups(a: np.ndarray, b: np.ndarray) -> bool:
    pairs = np.unique(np.column_stack([a, b]), axis=0)
    return len(pairs) == len(np.unique(a)) == len(np.unique(b))


@pytest.mark.parametrize("lon", [1.0, np.pi - 1e-9])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_signs_of_a_street_through_two_cells_are_those_of_one_piece(seed: int, lon: float) -> None:
    """The second street runs along the antimeridian, its sides east and west of it."""
    drives = at_edge(street_scene(seed, 8, length_m=2000.0), lon)
    sightings = stack_sightings(drives)
    assert len(np.unique(cell_of(sightings.lat, sightings.lon))) >= 2
    whole = joined_signs(sightings)
    found = associate_by_cells(sightings)
    assert same_groups(whole, found)


def assert_same_map(a: Merged, b: Merged, sigmas: float) -> None:
    assert sorted(a.founders) == sorted(b.founders)
    order = [b.founders.index(key) for key in a.founders]
    for k, j in enumerate(order):
        one, two = a.signs[k], b.signs[j]
        turn = np.mod(one.lon_rad - two.lon_rad + np.pi, 2 * np.pi) - np.pi
        apart = MEAN_RADIUS * np.array([turn * np.cos(one.lat_rad), one.lat_rad - two.lat_rad])
        limit = sigmas * np.sqrt(np.diag(one.cov_enu)[:2]) + 1e-6
        assert (np.abs(apart) < limit).all()
        assert np.allclose(one.cov_enu, two.cov_enu, rtol=2 * sigmas, atol=1e-9)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_map_by_cells_is_the_map_in_one_piece(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Within a hundredth of a sigma: tiles are the same, only what groups and strays rest on has
    the halo for a horizon."""
    drives = at_edge(street_scene(seed, 8, length_m=2000.0), 1.0)
    by_cells = merge_drives(drives)
    monkeypatch.setattr(
        "automap.mapping.merge.associate_by_cells",
        lambda sightings, progress: joined_signs(sightings),
    )
    assert_same_map(merge_drives(drives), by_cells, 0.01)


def test_the_order_of_the_drives_changes_no_bit() -> None:
    drives = at_edge(street_scene(4, 6, length_m=2000.0), np.pi)
    one, two = merge_drives(drives), merge_drives(drives[::-1])
    assert one.founders == two.founders
    assert np.array_equal(one.adjusted.lat, two.adjusted.lat)
    assert np.array_equal(one.adjusted.cov_enu, two.adjusted.cov_enu)
    assert np.array_equal(one.existence, two.existence)


def test_every_sighting_is_in_one_sign_where_signs_stand_on_the_edge() -> None:
    """The left side of the street is an edge between two columns of cells."""
    scene = street_scene(6, 6, length_m=1500.0)
    edge = -np.pi + 2.0 * np.pi * 9000 / (1 << LEVEL)
    drives = [moved(d, -0.6, edge + 5.0 / MEAN_RADIUS / np.cos(0.6)) for d in scene.drives]
    sightings = stack_sightings(drives)
    found = associate_by_cells(sightings)
    assert (found >= 0).all()
    home = cell_of(sightings.lat, sightings.lon)
    spread = np.array([len(np.unique(home[found == k])) for k in range(int(found.max()) + 1)])
    assert (spread > 1).sum() > 10
    whole = joined_signs(sightings)
    assert same_groups(whole, found)


@pytest.mark.parametrize("latitude", others_slow([45.0, 0.0, 85.04, -85.05, 89.0, 84.0], fast=5))
@pytest.mark.parametrize("margin_m", [100.0, 400.0, 3000.0])
def test_the_cells_beside_one_are_all_that_may_be_around_it(
    latitude: float, margin_m: float
) -> None:
    """Also across 180 degrees, and up to where all of a pole is one cell."""
    north, east = np.meshgrid(np.linspace(-0.4, 0.4, 81), np.linspace(179.4, 180.6, 81))
    lat = np.radians(np.clip(latitude + north.ravel(), -90.0, 90.0))
    lon = np.radians(east.ravel())
    middle = int(cell_of(np.radians([latitude]), np.array([np.pi]))[0])
    found = beside(middle, margin_m)
    if found is None:
        assert abs(latitude) > 85.0
    else:
        near = cell_of(lat, lon)[meets(middle, squares(lat, lon, margin_m))]
        assert len(near)
        assert set(near.tolist()) <= set(found)
