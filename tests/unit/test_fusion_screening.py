"""Wrong fixes in a row, and accuracy figures that jump."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.layout import HAS_POS_H, HAS_POS_V, HAS_VEL_H, HAS_VEL_V
from automap.fusion.measurements.position import hold_reported_sd
from automap.fusion.nodes import FixModel, Shift, build_nodes
from automap.fusion.options import FusionOptions
from automap.fusion.screening import screen_fixes

LAT, LON = 0.6, 0.2
M_LAT, M_LON = 1 / 6.36e6, 1 / (6.38e6 * np.cos(LAT))
ALL = HAS_POS_H | HAS_POS_V | HAS_VEL_H | HAS_VEL_V


def _drive(seed: int = 0, seconds: float = 120.0) -> FixModel:
    """A winding drive at 5 Hz with white errors of 0.3 m and 0.07 m/s."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.2)
    course = 0.8 * np.sin(0.05 * t)
    velocity = 12.0 * np.stack([np.cos(course), np.sin(course), 0 * t], axis=1)
    place = np.cumsum(velocity, axis=0) * 0.2
    place += 0.3 * rng.standard_normal(place.shape)
    measured = velocity + 0.07 * rng.standard_normal(velocity.shape)
    values = np.column_stack(
        [LAT + place[:, 0] * M_LAT, LON + place[:, 1] * M_LON, 100 - place[:, 2], measured]
    )
    n = len(t)
    var = np.column_stack([np.full((n, 3), 0.3**2), np.full((n, 3), 0.07**2)])
    flags = np.full(n, ALL, np.int64)
    rows = np.arange(n, dtype=np.int64)
    return FixModel(t, flags, values, var, np.ones((n, 3)), rows, np.ones((n, 2)))


def _moved(model: FixModel, rows: slice, metres: float) -> FixModel:
    values = model.values.copy()
    values[rows, 0] += metres * M_LAT
    return replace(model, values=values)


@pytest.mark.parametrize(
    ("rows", "metres"), [(slice(0, 25), 57.0), (slice(200, 350), 30.0), (slice(-40, None), 40.0)]
)
def test_the_majority_decides_which_fixes_are_wild(rows: slice, metres: float) -> None:
    model = _moved(_drive(), rows, metres)
    found = screen_fixes(model, 60.0)
    wild = found.fixes.white_var[:, 0] > model.white_var[:, 0]
    expected = np.zeros(len(model.t), dtype=bool)
    expected[rows] = True
    assert np.array_equal(wild, expected)
    assert found.largest_m == pytest.approx(metres, abs=3.0)
    assert found.fixes.white_var[wild, 0].min() > (0.5 * metres) ** 2


@pytest.mark.parametrize("seed", range(5))
def test_good_fixes_stay_as_they_are(seed: int) -> None:
    model = _drive(seed)
    found = screen_fixes(model, 60.0)
    assert found.n_outliers == 0
    assert found.fixes is model


def test_a_receiver_that_errs_by_more_than_it_states_is_not_wild_at_every_fix() -> None:
    model = _drive()
    var = model.white_var.copy()
    var[:, :3] /= 9.0
    boast = replace(model, white_var=var, stated_sd=np.full((len(var), 3), 0.1))
    assert screen_fixes(boast, 60.0).n_outliers < 5
    found = screen_fixes(_moved(boast, slice(200, 250), 30.0), 60.0)
    assert set(range(200, 250)) <= set(found.outliers.tolist())
    assert found.n_outliers < 55


@pytest.mark.parametrize("lag_s", [0.15, 0.3])
def test_old_velocities_make_no_position_wild(lag_s: float) -> None:
    # hard braking and starting, velocities of a while ago
    t = np.arange(0.0, 120.0, 0.1)
    speed = 8.0 + 7.0 * np.sin(0.5 * t)
    rng = np.random.default_rng(3)
    velocity = np.zeros((len(t), 3))
    velocity[:, 0] = np.interp(t - lag_s, t, speed) + 0.03 * rng.standard_normal(len(t))
    north = np.cumsum(speed) * 0.1 + 0.02 * rng.standard_normal(len(t))
    values = np.column_stack(
        [LAT + north * M_LAT, np.full(len(t), LON), np.full(len(t), 100.0), velocity]
    )
    var = np.column_stack([np.full((len(t), 3), 0.02**2), np.full((len(t), 3), 0.03**2)])
    rows = np.arange(len(t), dtype=np.int64)
    flags, stated = np.full(len(t), ALL, np.int64), np.full((len(t), 3), 0.02)
    model = FixModel(t, flags, values, var, stated, rows, np.ones((len(t), 2)))
    assert screen_fixes(model, 60.0).n_outliers == 0
    jumped = _moved(model, slice(300, 306), 12.0)
    assert screen_fixes(jumped, 60.0).n_outliers == 6


def test_velocities_may_be_missing() -> None:
    model = _drive()
    model = replace(model, flags=np.full_like(model.flags, HAS_POS_H))
    found = screen_fixes(_moved(model, slice(100, 103), 40.0), 60.0)
    assert 1 <= found.n_outliers <= 6


def test_figures_follow_changes_and_not_jitter() -> None:
    rng = np.random.default_rng(1)
    sd = 1.4 * np.exp(0.03 * rng.standard_normal((400, 3)))
    sd[200:] *= 5.0
    held = hold_reported_sd(sd)
    assert len(np.unique(held[:, 0])) == 2
    assert held[250, 0] / held[100, 0] == pytest.approx(5.0, rel=0.2)


@pytest.mark.parametrize("repeats", [1, 2])
def test_figures_that_scatter_widely_are_held(repeats: int) -> None:
    rng = np.random.default_rng(2)
    sd = np.repeat(1.8 * rng.uniform(0.8, 1.2, (800, 3)), repeats, axis=0)
    half = len(sd) // 2
    sd[half:] *= 5.0
    held = hold_reported_sd(sd)
    changes = np.flatnonzero(np.diff(held[:, 0]))
    assert changes.tolist() == [half - 1]
    assert held[[0, -1], 0] == pytest.approx([1.8, 9.0], rel=0.15)


def test_a_changed_figure_keeps_only_its_share_of_the_wander() -> None:
    model = _drive(seconds=20.0)
    wander = np.ones((len(model.t), 3))
    wander[50:] = 8.0
    model = replace(model, stated_sd=wander)
    empty = np.zeros(0)
    nodes = build_nodes(
        model, Shift(), (0.0, 19.0), [], empty, empty, empty, None, FusionOptions(), False
    )
    change = np.flatnonzero(nodes.lasting_keep[:, 0] < 1.0)
    assert len(change) == 1
    assert nodes.t[change[0]] == pytest.approx(model.t[50])
    assert nodes.lasting_keep[change[0]] == pytest.approx(1.0 / 8.0)
