"""Slopes of the likelihood along every noise level against its differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.adapt import scale_nodes, scale_problem
from automap.fusion.kernel_runs import PathStates, Start, run_forward
from automap.fusion.layout import HAS_POS_H, HAS_POS_V, HAS_VEL_H, HAS_VEL_V, NHC
from automap.fusion.level_likelihood import level_likelihood
from automap.fusion.levels import ALL_LEVELS
from automap.fusion.model import build_state_model
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.options import FusionOptions
from automap.fusion.problem import Problem, make_problem, with_options
from automap.fusion.sections import filter_and_smooth
from tests.unit.fusion_drive import Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_problem import make_nodes, true_start
from tests.unit.fusion_receiver import GPS0, Receiver, receive

OPTIONS = FusionOptions(
    effects=("accel_bias", "gyro_bias", "gnss_correlated_noise", "gnss_multipath"),
    accel_bias_walk=5e-3,
    gyro_bias_walk=3e-4,
    gyro_noise=2e-3,
    accel_noise=0.02,
    wander_tau_s=8.0,
    multipath_tau_s=2.0,
    velocity_wander_sd=0.1,
    velocity_wander_tau_s=1.5,
    gate_probability=1e-12,
)
STEP = 1e-4
"""Hardly a block begins to surprise within it."""
EXACT = -np.inf, np.inf


@pytest.fixture(scope="module")
def drive() -> tuple[Problem, Nodes, Start, PathStates]:
    """A quarter of a minute at five fixes a second; all channels that have a level."""
    motion = city_drive(15.0, 5, start_speed=8.0)
    sensor = Sensor(gyro_noise=3e-3, accel_noise=0.03, vibration=0.0)
    fixes = receive(motion, Receiver(wander=(1.0, 1.4, 2.0), velocity=0.1, tau=8.0), 7)
    t = fixes.gps_s - GPS0
    k = len(t)
    values = np.column_stack(
        [fixes.lat_rad, fixes.lon_rad, fixes.height_m, fixes.vel_ned, np.zeros(k)]
    )
    flags = np.full(k, HAS_POS_H | HAS_POS_V | HAS_VEL_H | HAS_VEL_V | NHC)
    flags[::3] &= ~(HAS_POS_H | HAS_POS_V)
    sd = [0.25, 0.3, 0.45, 0.06, 0.08, 0.11, 0.05, 0.09] + [1.0] * 7
    nodes = make_nodes(
        t, flags, values, np.tile(np.square(sd), (k, 1)), np.tile([1.0, 1.4, 2.0], (k, 1))
    )
    problem = make_problem(
        record(motion, sensor, 6, rate=50.0), build_state_model(OPTIONS), OPTIONS
    )
    start = true_start(motion, np.repeat([3.0, 0.5, 0.03], 3))
    _, smooth = filter_and_smooth(problem, nodes, start, Shift())
    return problem, nodes, start, PathStates(smooth.nominal, smooth.params)


@pytest.mark.parametrize("surprising", [1e-12, 0.3])
@pytest.mark.parametrize("level", ALL_LEVELS)
def test_slope_is_the_difference_of_the_likelihood(
    drive: tuple[Problem, Nodes, Start, PathStates], level: str, surprising: float
) -> None:
    """Of sound fixes, and where three blocks in ten are trusted less."""
    problem, nodes, start, about = drive
    problem = with_options(problem, replace(problem.options, gate_probability=surprising))
    one = dict.fromkeys(ALL_LEVELS, 1.0)

    def score(factor: float) -> float:
        factors = one | {level: factor}
        scaled = scale_problem(problem, factors)
        return level_likelihood(scaled, scale_nodes(nodes, factors), start, Shift(), about).score

    found = level_likelihood(problem, nodes, start, Shift(), about, left_out=EXACT)
    row = ALL_LEVELS.index(level)
    numeric = (score(np.exp(STEP)) - score(np.exp(-STEP))) / (2.0 * STEP)
    spread = np.sqrt(found.info[row])
    assert spread > 0.0
    assert found.slope[row] == pytest.approx(numeric, abs=0.01 * spread, rel=2e-3)


def test_the_likelihood_has_no_steps(drive: tuple[Problem, Nodes, Start, PathStates]) -> None:
    """Blocks begin to surprise, one after the other, as the receiver is said to be better."""
    problem, nodes, start, about = drive
    problem = with_options(problem, replace(problem.options, gate_probability=0.3))
    scores, surprised = [], set()
    for factor in np.exp(np.linspace(0.0, -0.02, 201)):
        factors = dict.fromkeys(ALL_LEVELS, 1.0) | {"velocity_h": factor}
        scaled = scale_nodes(nodes, factors)
        run = run_forward(problem, scaled, start, Shift(), linearised_at=about)
        scores.append(run.score)
        surprised.add(int((run.store.factor > 1.0).sum()))
    assert len(surprised) > 1
    slope = np.diff(scores)
    # a step of 1e-4 in a logarithm moves the score by that share of what its blocks' squares are
    assert np.abs(np.diff(slope)).max() < 0.02
