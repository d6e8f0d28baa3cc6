"""Noise levels by likelihood on a short drive; the long one is among the slow tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.adapt import FINE, _expected, adapt_noise, refine_noise
from automap.fusion.kernel_runs import PathStates, Start
from automap.fusion.layout import CH_NHC, CH_VEL, HAS_POS_H, HAS_POS_V, HAS_VEL_H, HAS_VEL_V, NHC
from automap.fusion.level_climb import climb
from automap.fusion.level_likelihood import LevelLikelihood
from automap.fusion.levels import ALL_LEVELS, LEVELS
from automap.fusion.model import build_state_model
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.options import FusionOptions
from automap.fusion.problem import Problem, make_problem
from automap.fusion.sections import filter_and_smooth
from automap.fusion.tuning import Tuned, shown_at_least, tune_noise
from tests.unit.fusion_drive import BASE_NS, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_problem import make_nodes, true_start
from tests.unit.fusion_receiver import GPS0, Receiver, receive

OFF = 3.0
OPTIONS = FusionOptions(effects=("accel_bias", "gyro_bias", "gnss_correlated_noise"))
VELOCITY_SD, WHITE = 0.05, 0.2
MEASURED = HAS_POS_H | HAS_POS_V | HAS_VEL_H | HAS_VEL_V


@pytest.fixture(scope="module")
def drive() -> tuple[Problem, Nodes, Start]:
    """Two minutes whose gyro and velocities are three times as noisy as the model says."""
    motion = city_drive(120.0, 5)
    sensor = Sensor(gyro_noise=OFF * OPTIONS.gyro_noise, accel_noise=OPTIONS.accel_noise)
    imu = record(motion, replace(sensor, vibration=0.0, gyro_walk=0.0, accel_walk=0.0), 6)
    white = (WHITE, WHITE, WHITE)
    fixes = receive(motion, Receiver(velocity=OFF * VELOCITY_SD, white=white), 7)
    inside = (fixes.gps_s >= GPS0) & (fixes.gps_s - GPS0 < 119.0)
    values = np.column_stack([fixes.lat_rad, fixes.lon_rad, fixes.height_m, fixes.vel_ned])[inside]
    t = fixes.gps_s[inside] - GPS0
    nodes = make_nodes(
        t, np.full(len(t), MEASURED | NHC), np.column_stack([values, np.zeros(len(t))])
    )
    nodes.var[:, :3] = WHITE**2
    nodes.var[:, 3:6] = VELOCITY_SD**2
    nodes.stated_sd[:] = (1.0, 1.0, 1.8)
    assert imu.t_ns[0] == BASE_NS
    problem = make_problem(imu, build_state_model(OPTIONS), OPTIONS)
    return problem, nodes, true_start(motion)


def _found(drive: tuple[Problem, Nodes, Start], nodes: Nodes) -> dict[str, float]:
    search = replace(FINE, levels=("gyro", "position_h", "velocity_h", "velocity_v"))
    problem, _, start = drive
    return adapt_noise(problem, nodes, start, Shift(), dict.fromkeys(LEVELS, 1.0), search)


def test_levels_that_are_off_are_found_and_others_left(
    drive: tuple[Problem, Nodes, Start],
) -> None:
    found = _found(drive, drive[1])
    for level in ("gyro", "velocity_h", "velocity_v"):
        assert OFF / 1.5 < found[level] < OFF * 1.5, level
    assert found["position_h"] == pytest.approx(1.0, rel=0.45)
    assert found["wander"] == 1.0


def test_how_loose_the_vehicle_rules_are_has_no_say(drive: tuple[Problem, Nodes, Start]) -> None:
    loose = replace(drive[1], var=drive[1].var.copy())
    loose.var[:, CH_NHC : CH_NHC + 2] = 100.0
    assert _found(drive, loose) == _found(drive, drive[1])


def _refined(drive: tuple[Problem, Nodes, Start], nodes: Nodes) -> dict[str, float]:
    problem, _, start = drive
    _, smooth = filter_and_smooth(problem, nodes, start, Shift())
    about = PathStates(smooth.nominal, smooth.params)
    coarse = dict.fromkeys(LEVELS, 1.0) | {"gyro": 2.0, "velocity_h": 4.0}
    return refine_noise(problem, nodes, start, Shift(), about, coarse)


def test_levels_are_refined_about_the_smoothed_path(drive: tuple[Problem, Nodes, Start]) -> None:
    found = _refined(drive, drive[1])
    assert found["gyro"] == pytest.approx(OFF, rel=0.35)
    for level in ("velocity_h", "velocity_v"):
        assert found[level] == pytest.approx(OFF, rel=0.12), level
    for level in ("position_h", "position_v"):
        assert found[level] == pytest.approx(1.0, rel=0.12), level
    # two minutes show the size of what lasts for one to half of it
    assert found["wander"] * OPTIONS.wander_share == pytest.approx(1.0, rel=0.5)
    # and that velocities here have nothing that lasts: it does not take the place of their noise
    assert found["velocity_wander"] * OPTIONS.velocity_wander_sd < VELOCITY_SD
    assert found["accel_bias_walk"] == found["wander_tau"] == 1.0


def test_how_long_velocities_err_is_for_the_drive_to_say(
    drive: tuple[Problem, Nodes, Start],
) -> None:
    """A quarter of a minute, where the setting says four seconds: velocities had been believed."""
    _, nodes, _ = drive
    rng, size, lasting_s = np.random.default_rng(3), 0.2, 15.0
    error = size * rng.standard_normal((len(nodes.t), 3))
    for k, step in enumerate(np.diff(nodes.t)):
        keep = np.exp(-step / lasting_s)
        error[k + 1] = keep * error[k] + np.sqrt(1.0 - keep**2) * error[k + 1]
    values = nodes.values.copy()
    values[:, CH_VEL : CH_VEL + 3] += error
    found = _refined(drive, replace(nodes, values=values))
    tau_s = OPTIONS.velocity_wander_tau_s * found["velocity_wander_tau"]
    # two minutes hold eight of them
    assert lasting_s / 2.5 < tau_s < lasting_s * 2.5
    assert found["velocity_wander"] * OPTIONS.velocity_wander_sd == pytest.approx(size, rel=0.5)


def test_refined_levels_do_not_ask_how_loose_the_rules_are(
    drive: tuple[Problem, Nodes, Start],
) -> None:
    loose = replace(drive[1], var=drive[1].var.copy())
    loose.var[:, CH_NHC : CH_NHC + 2] = 100.0
    tight, free = _refined(drive, drive[1]), _refined(drive, loose)
    # the path they are refined about differs a little
    assert free == pytest.approx(tight, rel=0.05)


def test_few_fixes_leave_the_levels_where_they_were_expected(
    drive: tuple[Problem, Nodes, Start],
) -> None:
    problem, nodes, start = drive
    few = nodes.first(4)
    _, smooth = filter_and_smooth(problem, few, start, Shift())
    about = PathStates(smooth.nominal, smooth.params)
    found = refine_noise(problem, few, start, Shift(), about, dict.fromkeys(LEVELS, 1.0))
    assert all(0.25 < factor < 4.0 for factor in found.values()), found
    assert found["accel"] == pytest.approx(1.0, rel=0.3)
    # where the fixes do not tell, an accelerometer has the noise that its readings show
    shaken = refine_noise(
        *(problem, few, start, Shift(), about, dict.fromkeys(LEVELS, 1.0)), shaken={"accel": 6.0}
    )
    assert 2.5 < shaken["accel"] < 6.0
    assert {k: v for k, v in shaken.items() if k != "accel"} == pytest.approx(
        {k: v for k, v in found.items() if k != "accel"}, rel=0.3
    )


@pytest.mark.parametrize("factor", [0.4, 1.7, 2.9, 3.1, 8.0])
def test_what_is_known_beforehand_has_exact_slopes(factor: float) -> None:
    row, step = ALL_LEVELS.index("accel"), 1e-4
    below, at, above = (
        _expected({"accel": factor * np.exp(d), "gyro": 2.0}, ("accel", "gyro"), 3.0)
        for d in (-step, 0.0, step)
    )
    assert at.slope[row] == pytest.approx((above.score - below.score) / (2.0 * step), rel=1e-3)
    assert (below.slope[row] - above.slope[row]) / (2.0 * step) == pytest.approx(at.info[row])
    # readings that differ by less say nothing
    free = _expected({"accel": factor, "gyro": 2.0}, ("accel", "gyro"), 0.0)
    assert (free.score > at.score) == (factor < 3.0)


def _likelihood(top: float, width: float) -> Callable[[dict[str, float]], LevelLikelihood]:
    """A hill at ``top`` of one level, flat where the level is far too small, as a variance is
    that vanishes beside others."""
    row = ALL_LEVELS.index("accel")

    def likelihood(factors: dict[str, float]) -> LevelLikelihood:
        variance = factors["accel"] ** 2 + width
        slope, info = np.zeros(len(ALL_LEVELS)), np.zeros(len(ALL_LEVELS))
        d = 50.0 * (top**2 + width) / variance - 50.0
        share = 2.0 * factors["accel"] ** 2 / variance
        slope[row], info[row] = d * share, 50.0 * share**2
        score = -50.0 * (np.log(variance) + (top**2 + width) / variance)
        return LevelLikelihood(float(score), slope, info)

    return likelihood


@pytest.mark.parametrize("start", [0.1, 0.7, 1.0, 8.0])
def test_the_climb_comes_back_from_flat_ground(start: float) -> None:
    hill = _likelihood(1.0, 0.5)
    top = climb(hill, dict.fromkeys(LEVELS, start), ("accel",), lambda level: (0.01, 100.0))
    found = top.factors
    assert found["accel"] == pytest.approx(1.0, rel=0.12)
    assert found["gyro"] == start


def test_a_known_curvature_saves_steps() -> None:
    calls = 0
    hill = _likelihood(1.0, 0.5)

    def counted(factors: dict[str, float]) -> LevelLikelihood:
        nonlocal calls
        calls += 1
        return hill(factors)

    first = climb(counted, dict.fromkeys(LEVELS, 1.6), ("accel",), lambda level: (0.01, 100.0))
    cold, calls = calls, 0
    start = dict.fromkeys(LEVELS, 1.6)
    again = climb(counted, start, ("accel",), lambda level: (0.01, 100.0), first.inverse)
    assert again.factors["accel"] == pytest.approx(1.0, rel=0.12)
    assert calls <= cold


def test_a_step_too_far_is_shortened_by_what_was_found() -> None:
    # a parabola whose curvature is taken for a hundredth of what it is
    row = ALL_LEVELS.index("accel")

    def steep(factors: dict[str, float]) -> LevelLikelihood:
        x = float(np.log(factors["accel"]))
        slope, info = np.zeros(len(ALL_LEVELS)), np.zeros(len(ALL_LEVELS))
        slope[row], info[row] = -2000.0 * (x - 0.1), 20.0
        return LevelLikelihood(-1000.0 * (x - 0.1) ** 2, slope, info)

    top = climb(steep, dict.fromkeys(LEVELS, 1.0), ("accel",), lambda level: (0.01, 100.0))
    assert np.log(top.factors["accel"]) == pytest.approx(0.1, abs=0.02)


def _tuned(drive: tuple[Problem, Nodes, Start], nodes: Nodes, begin: dict[str, float]) -> Tuned:
    problem, _, start = drive
    _, smooth = filter_and_smooth(problem, nodes, start, Shift())
    about = PathStates(smooth.nominal, smooth.params)
    return tune_noise(problem, nodes, start, Shift(), about, begin)


def test_tuned_levels_are_kept_where_the_other_half_of_the_drive_wants_them(
    drive: tuple[Problem, Nodes, Start],
) -> None:
    tuned = _tuned(drive, drive[1], dict.fromkeys(LEVELS, 1.0))
    assert tuned.better
    assert tuned.gain > 100.0
    assert tuned.factors["velocity_h"] == pytest.approx(OFF, rel=0.3)


def test_tuned_levels_are_dropped_where_the_other_half_contradicts_them(
    drive: tuple[Problem, Nodes, Start],
) -> None:
    """Velocities much better than stated in the first half, and as stated in the second."""
    nodes = drive[1]
    begin = dict.fromkeys(LEVELS, 1.0) | {"velocity_h": OFF, "velocity_v": OFF, "gyro": OFF}
    values = nodes.values.copy()
    rng = np.random.default_rng(2)
    late = slice(len(nodes.t) // 2, None)
    values[late, 3:6] += 10.0 * OFF * VELOCITY_SD * rng.standard_normal(values[late, 3:6].shape)
    begin |= {"velocity_h": 10.0 * OFF, "velocity_v": 10.0 * OFF}
    tuned = _tuned(drive, replace(nodes, values=values), begin)
    assert not tuned.better
    assert tuned.gain < 0.0
    assert tuned.factors == begin


def test_what_tuning_shrinks_of_lasting_errors_is_not_believed() -> None:
    shown = shown_at_least({"wander": 0.2, "gyro": 0.5}, {"wander": 0.8, "gyro": 1.0})
    assert shown == {"wander": 0.8, "gyro": 0.5}
