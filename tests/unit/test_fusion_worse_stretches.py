"""Stretches of a drive in which positions err by more than elsewhere."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.layout import HAS_POS_H
from automap.fusion.measurements.position import quick_factor
from automap.fusion.nodes import FixModel, Nodes, Shift, build_nodes, model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.passes import Pass
from automap.fusion.result import Prior
from automap.fusion.worse_stretches import (
    WorseStretches,
    _two_sizes,
    find_again,
    find_worse,
    fixes_in,
)
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
    t = fixes.gps_s - GPS0
    worse = (t % 80.0) < 20.0
    north, east = np.where(worse, 8.0, 0.0) * _wandering(seed, t, 10.0).T
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


def _wandering(seed: int, t: FloatArray, tau_s: float) -> FloatArray:
    """First-order Gauss-Markov processes [n, 2] of sigma one."""
    error: FloatArray = np.random.default_rng(seed).standard_normal((len(t), 2))
    for i, share in enumerate(np.exp(-np.diff(t) / tau_s).tolist()):
        error[i + 1] = share * error[i] + np.sqrt(1.0 - share**2) * error[i + 1]
    return error


def test_errors_of_seconds_stand_for_the_larger_steps() -> None:
    options = FusionOptions()
    quick = options.multipath_share * quick_factor(4.0, options)
    steps = [
        share**2 * -np.expm1(-0.5 * options.multipath_tau_s / tau_s)
        for share, tau_s in (
            (options.wander_share, options.wander_tau_s),
            (options.multipath_share, options.multipath_tau_s),
            (quick, options.multipath_tau_s),
        )
    ]
    assert steps[0] + steps[2] == pytest.approx(16.0 * (steps[0] + steps[1]))
    assert quick_factor(1.0, options) == pytest.approx(1.0)


def test_what_lasts_for_minutes_is_as_ever_in_a_stretch() -> None:
    fixes = receive(city_drive(60.0, 11), Receiver(), 13)
    t, options = fixes.gps_s - GPS0, FusionOptions()
    there = (t >= 20.0) & (t < 30.0)
    worse = WorseStretches(3.0, ((20.0, 30.0),), np.where(there, 3.0, 1.0))
    plain = model_fixes(fixes, t, options)
    empty = np.zeros(0)

    def nodes(model: FixModel) -> Nodes:
        return build_nodes(
            model, Shift(), (0.0, 59.0), [], empty, empty, empty, None, options, False
        )

    quick = nodes(fixes_in(plain, replace(worse, slow=False), options))
    assert quick.stated_sd == pytest.approx(nodes(plain).stated_sd)
    inside = (quick.t > 20.5) & (quick.t < 29.5)
    ratio = quick.quick_sd / quick.stated_sd
    assert ratio[inside] == pytest.approx(quick_factor(3.0, options))
    assert ratio[~inside & (np.abs(quick.t - 25.0) > 6.0)] == pytest.approx(1.0)
    # a slow error goes on through both edges, one of seconds begins and ends there
    assert (quick.lasting_keep[:, :3] == 1.0).all()
    assert np.count_nonzero(quick.lasting_keep[:, 3] < 1.0) == 2
    both = nodes(fixes_in(plain, worse, options))
    assert both.quick_sd == pytest.approx(both.stated_sd)
    assert both.stated_sd[inside] == pytest.approx(3.0 * quick.stated_sd[inside])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [20, 21])
def test_positions_that_wander_for_minutes_and_err_twice_as_much_in_places(seed: int) -> None:
    """A path is as unsure as they are: velocities had been taken for what drifts."""
    motion = city_drive(400.0, 11)
    imu = record(motion, Sensor(), 12)
    fixes = receive(motion, Receiver(wander=(0.1, 0.1, 0.1)), 13)
    t = fixes.gps_s - GPS0
    size = np.where((t + 8.0) % 90.0 < 22.0, 8.0, 4.0)
    north, east = (size[:, None] * _wandering(seed, t, 160.0)).T
    lat = fixes.lat_rad + north / 6.36e6
    lon = fixes.lon_rad + east / (6.38e6 * np.cos(fixes.lat_rad))
    stated = np.full((len(fixes), 3), 2.5)
    fixes = replace(fixes, lat_rad=lat, lon_rad=lon, sd_pos_ned=stated)
    result = fuse_imu_gnss(imu, fixes, CLOCK, FusionOptions(), Prior(0.0, 0.1), np.zeros(3))
    assert result.worse is not None
    off = errors(result.trajectory, motion)[:, :2] / result.trajectory.sd_pos_ned[:, :2]
    assert np.sqrt(np.mean(off**2)) < 1.5


@pytest.mark.slow
def test_what_a_receiver_states_is_no_surprise() -> None:
    """Positions that err by metres in stretches, as it says, and by less elsewhere."""
    motion = city_drive(300.0, 11)
    imu = record(motion, Sensor(), 12)
    fixes, _ = _reflected(receive(motion, Receiver(wander=(0.8, 0.8, 1.5), tau=30.0), 13), 14)
    fixes = replace(fixes, sd_pos_ned=np.full((len(fixes), 3), 12.0))
    result = fuse_imu_gnss(imu, fixes, CLOCK, FusionOptions(), Prior(0.0, 0.1), np.zeros(3))
    assert result.worse is None
