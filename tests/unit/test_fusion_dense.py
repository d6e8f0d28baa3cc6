"""Filter and smoother, with every channel at once, against a textbook filter with full matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from automap.frames import matrix_to_quat, quat_to_matrix
from automap.fusion.filtered import filtered_states, filtered_variances
from automap.fusion.kernel_runs import PathStates, SmoothRun
from automap.fusion.layout import (
    CHANNELS,
    HAS_POS_V,
    N_NAV,
)
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.output import Innovations, innovations
from automap.fusion.problem import Problem, with_options
from automap.fusion.sections import filter_and_smooth
from automap.fusion.stamp_error import reported_rows
from tests.unit.dense_filter import State
from tests.unit.dense_problem import FLAGS, OPTIONS, Both, solve_both

FILTER_SIGMAS, CHANNEL_SIGMAS = 0.03, 0.015
"""What second orders may come to, and the turn of the Earth that the transition leaves out."""


@pytest.fixture(scope="module")
def both() -> Both:
    return solve_both()


def _miss(nominal: np.ndarray, params: np.ndarray, states: list[State]) -> np.ndarray:
    """Differences [k, n] of the product's states from the textbook's."""
    rows = [
        State(
            nominal[k : k + 1, :3],
            nominal[k : k + 1, 3:6],
            quat_to_matrix(nominal[k : k + 1, 6:10]),
            params[k : k + 1],
        ).minus(states[k])[0]
        for k in range(len(states))
    ]
    return np.stack(rows)


def _sds(covs: list[np.ndarray]) -> np.ndarray:
    return np.sqrt(np.stack([np.diag(c) for c in covs]))


def test_innovations_and_their_spread_by_channel(both: Both) -> None:
    nu = np.concatenate(both.trace.innovation)
    sd = np.sqrt(np.concatenate(both.trace.innovation_var))
    assert both.table.accepted.all()
    for channel in CHANNELS:
        rows = both.table.channel == channel
        assert rows.sum() > 5, channel
        assert both.table.sd[rows] == pytest.approx(sd[rows], rel=CHANNEL_SIGMAS), channel
        assert np.abs((both.table.innovation - nu)[rows] / sd[rows]).max() < CHANNEL_SIGMAS, channel
    # the residuals are measurements' and no rounding
    assert 0.5 < np.sqrt(np.mean((nu / sd) ** 2)) < 2.0


def test_filtered_states_and_covariances(both: Both) -> None:
    nominal, params, cov = filtered_states(both.problem, both.forward)
    _compare(both, nominal, params, cov, both.trace.state, both.trace.cov)
    sd = _sds(both.trace.cov)[:, N_NAV:]
    variances = filtered_variances(both.problem, both.forward)
    assert np.sqrt(variances) == pytest.approx(sd, rel=FILTER_SIGMAS)


def test_smoothed_states_and_covariances(both: Both) -> None:
    s = both.smoothed
    _compare(both, s.nominal, s.params, s.cov, both.states, both.covs)
    noted = np.isfinite(s.param_var).all(axis=1)
    assert noted.sum() > 5
    sd = _sds(both.covs)[noted][:, N_NAV:]
    assert np.sqrt(s.param_var[noted]) == pytest.approx(sd, rel=FILTER_SIGMAS)


def _compare(
    both: Both,
    nominal: np.ndarray,
    params: np.ndarray,
    cov: np.ndarray,
    states: list[State],
    covs: list[np.ndarray],
) -> None:
    miss, sd = _miss(nominal, params, states), _sds(covs)
    off = np.abs(miss / sd).max(axis=0)
    names = (
        *(f"{kind}_{a}" for kind in ("p", "v", "phi") for a in "ned"),
        *both.problem.model.names,
    )
    assert off.max() < FILTER_SIGMAS, names[int(off.argmax())]
    rows = reported_rows(both.problem.model)
    size = sd[:, rows][:, :, None] * sd[:, rows][:, None, :]
    dense = np.stack(covs)[:, rows][:, :, rows]
    assert np.abs((cov - dense) / size).max() < FILTER_SIGMAS


def test_likelihood_of_all_measurements(both: Both) -> None:
    assert both.forward.score == pytest.approx(both.trace.score, abs=0.05)


def test_the_estimate_does_not_hang_on_the_path_linearised_about(both: Both) -> None:
    """Where the path is a third of a sigma off, another way at every node, the filter's mean makes
    up for it: in eight draws, for a single one says as much of its own numbers."""
    rng = np.random.default_rng(9)
    sd = _sds(both.covs)

    def smoothed_about(size: float) -> np.ndarray:
        moved = [
            state.moved(size * s[None] * rng.uniform(-1.0, 1.0, (1, len(s))))
            for state, s in zip(both.states, sd, strict=True)
        ]
        rows = [np.concatenate([m.place[0], m.vel[0], matrix_to_quat(m.c)[0]]) for m in moved]
        about = PathStates(np.stack(rows), np.stack([m.par[0] for m in moved]))
        nodes = both.forward.nodes
        _, smoothed = filter_and_smooth(both.problem, nodes, both.start, Shift(), about)
        return _miss(smoothed.nominal, smoothed.params, both.states) / sd

    plain = smoothed_about(0.0)
    off = np.stack([smoothed_about(0.3) - plain for _ in range(8)])
    assert np.sqrt(np.mean(off**2, axis=0)).max() < 0.03
    # where the filter linearised about its own first guesses it was off by as much as this
    assert np.abs(plain).max() < 0.3


@pytest.mark.parametrize(
    "rows",
    [
        ("position_n", "position_e", "position_d"),
        ("position_n", "position_e"),
        ("velocity_n", "velocity_e", "velocity_d"),
        ("odometer",),
    ],
)
def test_a_surprising_block_is_trusted_less_until_it_is_none(
    both: Both, rows: tuple[str, ...]
) -> None:
    """The same as stating its variances larger by the factor that brings its NIS to the gate."""
    whole = both.forward.nodes
    wanted = sum({FLAGS[c] for c in rows})
    mask = wanted | (HAS_POS_V if "position_n" in rows else 0)
    k = 12 + int(np.flatnonzero((whole.flags[12:] & mask) == wanted)[0])
    whole = whole.first(k + 3)
    values, var = whole.values.copy(), whole.var
    values[k, 1] += 5e-5 * ("position_e" in rows)
    values[k, 3:5] += np.array([12.0, -7.0]) * ("velocity_n" in rows)
    values[k, 6] += 20.0 * ("odometer" in rows)
    wild = replace(whole, values=values)
    open_gate = with_options(both.problem, replace(OPTIONS, gate_probability=0.0))

    def run(problem: Problem, nodes: Nodes) -> tuple[Innovations, SmoothRun, float]:
        forward, smoothed = filter_and_smooth(problem, nodes, both.start, Shift())
        return innovations(forward, 0, np.zeros(0, np.int64)), smoothed, forward.score

    def at(table: Innovations) -> np.ndarray:
        return (table.t_ns == round(whole.t[k] * 1e9)) & np.isin(table.channel, rows)

    table, smoothed, score = run(both.problem, wild)
    plain, _, _ = run(open_gate, wild)
    here = at(table)
    nis = float(np.sum((plain.innovation[here] / plain.sd[here]) ** 2))
    gate = chi2.isf(OPTIONS.gate_probability, len(rows))
    assert nis > 3.0 * gate
    assert table.nis[here] == pytest.approx(nis, rel=1e-6)
    assert not table.accepted[here].any()
    assert table.accepted[~here].all()
    first = CHANNELS.index(rows[0])
    factor = 1.0 + (table.sd[here][0] ** 2 - plain.sd[here][0] ** 2) / var[k, first]
    wider = var.copy()
    wider[k, [CHANNELS.index(c) for c in rows]] *= factor
    again, same, likelihood = run(open_gate, replace(wild, var=wider))
    left = float(np.sum((again.innovation[here] / again.sd[here]) ** 2))
    assert left == pytest.approx(gate, rel=1e-6)
    assert table.sd == pytest.approx(again.sd, rel=1e-6)
    assert table.innovation == pytest.approx(again.innovation, rel=1e-4, abs=1e-7)
    assert score == pytest.approx(likelihood, abs=1e-3)
    sd = _sds(both.covs)[: k + 3]
    assert np.abs((smoothed.params - same.params) / sd[:, N_NAV:]).max() < 1e-5
    assert np.abs((smoothed.nominal - same.nominal)[:, 3:6] / sd[:, 3:6]).max() < 1e-5
