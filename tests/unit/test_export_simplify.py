"""Thinning of a path."""

from __future__ import annotations

import numpy as np
import pytest
from export_inputs import trajectory
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.export.path import simplified_path, split_at_date_line
from automap.export.simplify import keep_indices


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(2, 300), st.floats(0.05, 5.0))
def test_every_point_stays_within_the_tolerance(seed: int, size: int, tolerance: float) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.05, 1.0, size))
    values = np.cumsum(rng.normal(0, 1, (size, 3)), axis=0)
    kept = keep_indices(time, values, tolerance)
    assert kept[0] == 0
    assert kept[-1] == size - 1
    assert (np.diff(kept) > 0).all()
    chord = np.column_stack([np.interp(time, time[kept], v[kept]) for v in values.T])
    assert np.linalg.norm(values - chord, axis=1).max() <= tolerance


def test_a_stop_on_a_straight_road_survives() -> None:
    time = np.arange(0.0, 30.0, 0.1)
    along = np.where(time < 10, 10 * time, np.where(time < 20, 100.0, 10 * time - 100))
    values = np.column_stack([along, np.zeros_like(along)])
    kept = keep_indices(time, values, 0.5)
    assert len(kept) <= 8
    assert np.interp(15.0, time[kept], along[kept]) == pytest.approx(100.0, abs=0.5)


def test_the_limit_holds() -> None:
    rng = np.random.default_rng(2)
    time = np.arange(2000.0)
    kept = keep_indices(time, rng.normal(0, 10, (2000, 2)), 0.01, limit=100)
    assert 2 <= len(kept) <= 100


def test_path_is_short_and_true() -> None:
    full = trajectory(seconds=300.0)
    path = simplified_path(full)
    assert len(path) < len(full) / 20
    lat = np.interp(full.t_ns, path.t_ns, np.radians(path.lat_deg))
    assert np.abs(lat - full.lat_rad).max() * 6.37e6 < 0.25
    assert np.diff(path.t_ns).max() <= 20e9
    assert path.t_ns[-1] >= full.t_ns[-1] - 0.2e9


def test_path_over_the_date_line_is_cut_not_stretched() -> None:
    assert split_at_date_line(np.array([179.9, 179.99, -179.99, -179.9])) == [
        slice(0, 2),
        slice(2, 4),
    ]
    assert split_at_date_line(np.array([1.0, 2.0])) == [slice(0, 2)]
