"""Small formulas of the merging against SciPy and against what a probability has to be."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from automap.mapping.candidates import (
    A_EE,
    A_EN,
    A_NN,
    A_U,
    B_E,
    B_N,
    B_U,
    CELL_M,
    CLASS_SLOTS,
    HEIGHT,
    LAT,
    LON,
    PLACES,
    STATE,
    Columns,
    MapSigns,
    facing_evidence,
    facing_variance,
    find_candidates,
    match_gain,
    mean_of,
)
from automap.mapping.grid import delta, filled_table, neighbours
from automap.mapping.limits import FACING_LIMIT, FACING_SD, MOST, NEW_PER_M, NEW_PER_M2
from automap.mapping.sightings import stack_sightings


def test_the_mean_place_of_a_sign_is_that_of_the_normal_equations() -> None:
    rng = np.random.default_rng(1)
    for _ in range(10):
        root, place, up = rng.normal(size=(2, 2)), rng.normal(0.0, 3.0, 2), rng.normal()
        information = root @ root.T + 0.1 * np.eye(2)
        pull = information @ place
        state = np.zeros(STATE)
        state[[A_EE, A_EN, A_NN]] = information[0, 0], information[0, 1], information[1, 1]
        state[[B_E, B_N]] = pull
        assert np.isnan(mean_of(state)[2])
        state[A_U], state[B_U] = 4.0, 4.0 * up
        assert mean_of(state) == pytest.approx((*place, up))


def test_evidence_of_an_angle_is_a_density_against_any_direction() -> None:
    angles = np.linspace(-np.pi, np.pi, 20_001)
    told = np.array([facing_evidence(a) for a in angles])
    density = np.exp(told) / (2.0 * np.pi)
    # all of it lies within the limit
    assert np.trapezoid(density, angles) == pytest.approx(1.0, abs=1e-3)
    assert np.all(np.isneginf(told[np.abs(angles) > FACING_LIMIT + 1e-9]))
    assert np.all(np.isfinite(told[np.abs(angles) < FACING_LIMIT - 1e-9]))
    for turn in (2.0 * np.pi, -4.0 * np.pi):
        assert [facing_evidence(a + turn) for a in (-0.2, 0.1)] == pytest.approx(
            [facing_evidence(0.2), facing_evidence(-0.1)]
        )


def test_a_face_of_which_its_drive_is_unsure_says_little_either_way() -> None:
    """Whatever a drive states of it, all of the density is within the circle's evidence."""
    angles = np.linspace(-np.pi, np.pi, 2001)
    sure, unsure = (
        np.array([facing_evidence(a, 2.0 * facing_variance(np.radians(sd))) for a in angles])
        for sd in (5.0, 60.0)
    )
    assert facing_variance(np.nan) == facing_variance(0.1) == 0.5 * FACING_SD**2
    assert np.isfinite(unsure).all()
    assert np.ptp(unsure) < 4.0 < np.ptp(sure[np.isfinite(sure)])
    # the other face of a sign stays another
    assert np.isneginf(sure[[0, -1]]).all()


def test_agreement_of_place_is_a_normal_density_against_new_signs() -> None:
    covariance = np.array([[2.0, 0.7], [0.7, 0.5]])
    plan = multivariate_normal(np.zeros(2), covariance).logpdf(np.zeros(2)) - np.log(NEW_PER_M2)
    given = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    assert match_gain(*given, np.nan) == pytest.approx(plan)
    up = norm(0.0, np.sqrt(0.3)).logpdf(0.0) - np.log(NEW_PER_M)
    assert match_gain(*given, 0.3) == pytest.approx(plan + up)


@pytest.mark.parametrize(
    ("lat", "lon"), [(0.0, 0.4), (-35.2, 149.1), (69.9, 180.0), (89.9995, 10.0)]
)
def test_all_neighbours_are_found_wherever_they_are(lat: float, lon: float) -> None:
    """Also over the date line and beside a pole; distances by the chord through the globe."""
    rng = np.random.default_rng(3)
    radius, cell_m, n = 6371000.0, 16.0, 300
    lat_rad = np.radians(lat) + rng.uniform(-60.0, 60.0, n) / radius
    lat_rad = np.minimum(lat_rad, np.pi / 2.0 - 1e-9)
    lon_rad = np.radians(lon) + rng.uniform(-60.0, 60.0, n) / (radius * np.cos(np.radians(lat)))
    lon_rad = (lon_rad + np.pi) % (2.0 * np.pi) - np.pi
    table = filled_table(lat_rad, lon_rad, cell_m)
    place = radius * np.column_stack(
        [np.cos(lat_rad) * np.cos(lon_rad), np.cos(lat_rad) * np.sin(lon_rad), np.sin(lat_rad)]
    )
    found = np.empty(n, np.int64)
    for k in range(0, n, 7):
        count = neighbours(table, lat_rad[k], lon_rad[k], 1, found)
        near = np.flatnonzero(np.linalg.norm(place - place[k], axis=1) < cell_m)
        assert set(near) <= set(found[:count].tolist())
        assert len(set(found[:count].tolist())) == count
        # no more than nine cells, of which a pole's may be wide
        assert lat > 89.0 or count < n // 2
    assert neighbours(table, lat_rad[0], lon_rad[0], 1, found[:1]) == 1


@pytest.mark.parametrize(("a", "b"), [(0.2, 0.1), (np.pi - 1e-6, -np.pi + 1e-6)])
def test_a_difference_of_places_is_the_short_way_round(a: float, b: float) -> None:
    """The second pair lies on both sides of the date line, two millionths of a radian apart."""
    per_lat, per_lon = 6.4e6, 4.2e6
    apart = a - b if abs(a - b) < 1.0 else -2e-6
    assert delta(0.7, a, 0.6, b, per_lat, per_lon) == pytest.approx(
        (apart * per_lon, 0.1 * per_lat)
    )
    assert delta(0.6, b, 0.7, a, per_lat, per_lon) == pytest.approx(
        (-apart * per_lon, -0.1 * per_lat)
    )


def test_of_no_drives_there_are_no_sightings() -> None:
    none = stack_sightings([])
    columns = {f.name: getattr(none, f.name) for f in fields(none)}
    assert {name: len(values) for name, values in columns.items() if len(values)} == {"first": 1}


def test_a_sighting_beyond_the_gate_is_no_candidate_whichever_way_it_lies() -> None:
    """Gates are of the distance in plan: 3 m are near and 9 m are far, 1 m being one sigma."""
    away = np.array([[3.0, 0.0], [0.0, 3.0], [9.0, 0.0], [0.0, 9.0], [6.5, 6.5], [0.0, -20.0]])
    n, per_lat, per_lon = len(away), 6.37e6, 4.44e6
    state = np.zeros((1, STATE))
    state[0, [LAT, LON, HEIGHT]] = 0.8, 0.2, 100.0
    state[0, [A_EE, A_NN, A_U]] = 2.0
    lat, lon = 0.8 + away[:, 1] / per_lat, 0.2 + away[:, 0] / per_lon
    index, values = np.full((n, MOST), -1, np.int64), np.zeros((n, MOST, PLACES))
    seen = Columns(
        *(np.zeros(n), lat, lon, np.full(n, 100.0), np.full(n, per_lat), np.full(n, per_lon)),
        *(np.tile([0.5, 0.0, 0.5], (n, 1)), np.full(n, 0.5), np.zeros((n, 3))),
        *(np.full(n, np.nan), np.zeros(n), np.zeros(n, np.int64), np.ones(n)),
    )
    slots = np.zeros((1, CLASS_SLOTS), np.int64), np.zeros((1, CLASS_SLOTS))
    table = filled_table(state[:, LAT], state[:, LON], CELL_M)
    signs = MapSigns(state, *slots, np.ones(1, np.bool_), table)
    find_candidates(0, n, seen, np.zeros((1, 1)), signs, index, values)
    assert (index[:, 0] == 0).tolist() == [True, True, False, False, False, False]
