"""Stretches of a drive in which positions err by more than elsewhere."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.layout import HAS_POS_H
from automap.fusion.options import FusionOptions
from automap.fusion.passes import Pass
from automap.fusion.result import Prior
from automap.fusion.worse_stretches import WorseStretches, _two_sizes, find_again, find_worse
from automap.records import BoolArray, Fixes, FloatArray
from tests.unit.fusion_drive import CLOCK, Sensor, errors, horizontal_rms, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_problem import make_nodes
from tests.unit.fusion_receiver import GPS0, Receiver, receive

WINDOWS = 120
WORSE = np.isin(np.arange(WINDOWS) // 5, (3, 9, 14, 15))


def _steps(seed: int, times: float = 1.0) -> FloatArray:
    step: FloatArray = 0.6 * np.random.default_rng(seed).standard_normal((WINDOWS, 2))
    step[WORSE] *= times
    return step


def _told(found: tuple[float, float, FloatArray] | None) -> BoolArray:
    assert found is not None
    return np.asarray(found[2] > 0.5)


@pytest.mark.parametrize("seed", range(4))
def test_worse_windows_are_found_and_how_much_worse(seed: int) -> None:
    found = _two_sizes(_steps(seed, 5.0), np.ones(WINDOWS, np.bool_))
    assert found is not None
    assert 3.5 < found[0] < 7.5
    assert 2.0 < found[1] < 4.5
    assert (_told(found) == WORSE).mean() > 0.93


def test_one_size_is_one_size() -> None:
    told = np.ones(WINDOWS, np.bool_)
    assert not any(_two_sizes(_steps(seed), told) for seed in range(20))


@pytest.mark.parametrize("metres", [5.0, 50.0, 5000.0])
def test_a_jump_and_a_return_are_no_stretches(metres: float) -> None:
    step = _steps(7)
    step[[40, 80], 0] += metres, -metres
    assert _two_sizes(step, np.ones(WINDOWS, np.bool_)) is None


def test_what_is_worse_most_of_the_time_is_the_usual() -> None:
    step = _steps(3, 0.1)
    step[~WORSE & (np.arange(WINDOWS) < 30)] *= 0.1
    assert _two_sizes(step, np.ones(WINDOWS, np.bool_)) is None


def test_windows_at_rest_do_not_count() -> None:
    step = _steps(5, 1e-3)
    assert _two_sizes(step, ~WORSE) is None


def _pass(stated_m: float, seed: int = 2) -> Pass:
    """A vehicle that goes north, with fixes at 1 Hz that step by 0.5 m in five seconds, but by 5 m
    from 100 to 150 s and 300 to 350 s."""
    t = np.arange(600.0)
    rng = np.random.default_rng(seed)
    worse = ((t >= 100.0) & (t < 150.0)) | ((t >= 300.0) & (t < 350.0))
    off = np.where(worse, 5.0, 0.5)[:, None] * np.repeat(rng.standard_normal((120, 2)), 5, axis=0)
    nominal = np.zeros((600, 10))
    nominal[:, 0], nominal[:, 3], nominal[:, 6] = t * 1.6e-6, 10.0, 1.0
    values = nominal[:, :6].copy()
    values[:, :2] += off / 6.37e6
    nodes = make_nodes(t, np.full(600, HAS_POS_H), values, stated_sd=np.full((600, 3), stated_m))
    nodes = replace(nodes, fix_row=np.arange(600))
    made = SimpleNamespace(nodes=nodes, smooth=SimpleNamespace(nominal=nominal), totals=dict)
    return cast(Pass, made)


def test_stretches_are_those_of_the_fixes() -> None:
    found = find_worse(_pass(1.0), 5.0, 700)
    assert found is not None
    # the way back is a step, too
    ends = [x for span in found.spans for x in span]
    assert ends == pytest.approx([100.0, 150.0, 300.0, 350.0], abs=6.0)
    assert found.seconds == pytest.approx(105.0, abs=11.0)
    assert found.factor.shape == (700,)
    assert found.factor[110:140].min() > 3.0
    assert found.factor[200:290].max() < 1.5
    assert (found.factor[600:] == 1.0).all()
    assert found.at(np.array([-1, 120, -1, 250])).ravel() == pytest.approx(
        found.factor[[120, 120, 120, 250]]
    )


def test_by_a_path_that_trusts_them_less_they_are_found_to_the_second() -> None:
    rough = WorseStretches(3.0, ((95.0, 160.0),), np.ones(700))
    found = find_again(_pass(1.0), 5.0, rough)
    ends = [x for span in found.spans for x in span]
    assert ends == pytest.approx([100.0, 150.0, 300.0, 350.0], abs=1.5)
    assert 6.0 < found.times < 16.0
    assert found.there.shape == (700,)
    assert found.there[105:145].all()
    assert not found.there[155:295].any()


def test_stretches_that_do_not_show_again_stay() -> None:
    made = _pass(1.0)
    nodes = replace(made.nodes, values=made.smooth.nominal[:, :6].copy())
    rough = WorseStretches(3.0, ((95.0, 160.0),), np.ones(700))
    same = cast(Pass, SimpleNamespace(nodes=nodes, smooth=made.smooth, totals=dict))
    assert find_again(same, 5.0, rough) is rough


def test_errors_that_the_receiver_states_are_left_to_it() -> None:
    assert find_worse(_pass(20.0), 5.0, 600) is None


def _reflected(fixes: Fixes, seed: int) -> tuple[Fixes, BoolArray]:
    """Positions off by some 8 m for ten seconds at a time in a quarter of the drive, unstated."""
    rng = np.random.default_rng(seed)
    t = fixes.gps_s - GPS0
    worse = (t % 80.0) < 20.0
    error = rng.standard_normal((len(t), 2))
    keep = np.exp(-np.diff(t) / 10.0)
    for i, share in enumerate(keep.tolist()):
        error[i + 1] = share * error[i] + np.sqrt(1.0 - share**2) * error[i + 1]
    north, east = np.where(worse, 8.0, 0.0) * error.T
    lat = fixes.lat_rad + north / 6.36e6
    lon = fixes.lon_rad + east / (6.38e6 * np.cos(fixes.lat_rad))
    return replace(fixes, lat_rad=lat, lon_rad=lon), worse


@pytest.mark.slow
def test_reflections_leave_the_path_to_the_other_positions() -> None:
    """Without it errors of minutes are taken for as large as those of the stretches."""
    motion = city_drive(400.0, 11)
    imu = record(motion, Sensor(), 12)
    receiver = Receiver(wander=(0.8, 0.8, 1.5), tau=30.0, lasting=0.12, lasting_tau=8.0)
    fixes, worse = _reflected(receive(motion, receiver, 13), 14)
    result = fuse_imu_gnss(imu, fixes, CLOCK, FusionOptions(), Prior(0.0, 0.1), np.zeros(3))
    assert result.worse is not None
    assert any("positions err by" in text for text in result.warnings)
    told = result.worse.factor > 2.0
    assert told[worse].mean() > 0.75
    assert told[~worse].mean() < 0.05
    found = errors(result.trajectory, motion)
    assert horizontal_rms(found) < 1.5
    assert np.hypot(*result.trajectory.sd_pos_ned[:, :2].T).mean() < 4.0


@pytest.mark.slow
def test_what_a_receiver_states_is_no_surprise() -> None:
    """Positions that err by metres in stretches, as it says, and by less elsewhere."""
    motion = city_drive(300.0, 11)
    imu = record(motion, Sensor(), 12)
    fixes, _ = _reflected(receive(motion, Receiver(wander=(0.8, 0.8, 1.5), tau=30.0), 13), 14)
    fixes = replace(fixes, sd_pos_ned=np.full((len(fixes), 3), 12.0))
    result = fuse_imu_gnss(imu, fixes, CLOCK, FusionOptions(), Prior(0.0, 0.1), np.zeros(3))
    assert result.worse is None
