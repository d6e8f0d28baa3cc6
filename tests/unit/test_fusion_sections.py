"""A drive filtered and smoothed in sections gives what it gives in one piece."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from automap.fusion import dense_pieces as pieces
from automap.fusion.kernel_runs import PathStates, run_dense, run_forward, run_smoother
from automap.fusion.nodes import Shift
from automap.fusion.sections import _bounds, filter_and_smooth
from tests.unit.test_fusion_smoother import _problem


@pytest.mark.parametrize("relinearise", [False, True])
@pytest.mark.parametrize("section", [11, 1000])
def test_sections_change_nothing(section: int, relinearise: bool) -> None:
    problem, forward, start = _problem(20.0, gate=1e-3)
    nodes = forward.nodes
    whole = run_smoother(problem, forward)
    about = PathStates(whole.nominal, whole.params) if relinearise else None
    one = run_forward(problem, nodes, start, Shift(), linearised_at=about)
    whole = run_smoother(problem, one)
    run, smooth = filter_and_smooth(
        problem, nodes, start, Shift(), linearised_at=about, section_nodes=section
    )
    assert (run.cov is not None) == (section < len(nodes.t))
    assert run.score == pytest.approx(one.score, rel=1e-9)
    for name in ("nominal", "params", "mean", "nu", "var"):
        ours, theirs = getattr(run.store, name), getattr(one.store, name)
        assert ours == pytest.approx(theirs, rel=1e-7, abs=1e-8), name
    assert np.array_equal(run.store.scalars, one.store.scalars)
    assert np.array_equal(run.store.info, one.store.info)
    sd = np.sqrt(np.einsum("kii->ki", whole.cov))[:, :9]
    metres = np.array([6.4e6, 5.2e6, 1.0])
    assert np.abs((smooth.nominal - whole.nominal)[:, :3] * metres / sd[:, :3]).max() < 1e-4
    assert np.abs((smooth.nominal - whole.nominal)[:, 3:6] / sd[:, 3:6]).max() < 1e-4
    scale = sd[:, :, None] * sd[:, None, :]
    assert np.abs((smooth.cov - whole.cov)[:, :9, :9] / scale).max() < 1e-5
    assert smooth.params == pytest.approx(whole.params, rel=1e-5, abs=1e-8)


@pytest.mark.parametrize("blend", [False, True])
def test_states_at_the_samples_are_the_same_stretch_by_stretch(
    blend: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, forward, _ = _problem(20.0, gate=1e-3)
    smooth = run_smoother(problem, forward)
    nodes, path = smooth.nodes, PathStates(smooth.nominal, smooth.params)
    whole, _ = run_dense(problem, nodes, path.nominal, path.params, blend)
    known = np.asarray(np.isfinite(whole).all(axis=1))
    monkeypatch.setattr(pieces, "PIECE_ROWS", 97)
    done = 0
    for piece in pieces.dense_pieces(problem, nodes, path, blend, 0.5):
        assert piece.rows.start == done
        done = piece.rows.stop
        own = piece.dense[piece.rows.start - piece.around.start :][: done - piece.rows.start]
        rows = np.arange(piece.rows.start, done)
        told = known[rows]
        assert np.array_equal(own[told], whole[rows[told]])
        assert np.isfinite(own).all()
        # round about, what is between the samples is known as well
        t = problem.t[piece.around]
        assert t[0] <= max(problem.t[0], problem.t[rows[0]] - 0.5)
        assert t[-1] >= min(problem.t[-1], problem.t[rows[-1]] + 0.5)
    assert done == len(problem.t)


@pytest.mark.parametrize(
    ("times", "wanted"),
    [
        ([0.0], [0, 0]),
        ([0.0, 1.0, 2.0], [0, 2]),
        ([0.0, 1.0, 2.0, 3.0, 4.0], [0, 2, 4]),
        # no cut where no time passes after a node, be it up to the last
        ([0.0, 1.0, 2.0, 2.0, 3.0, 4.0, 5.0], [0, 3, 5, 6]),
        ([0.0, 1.0, 2.0, 2.0, 2.0], [0, 4]),
    ],
)
def test_sections_end_where_time_passes(times: list[float], wanted: list[int]) -> None:
    nodes: Any = SimpleNamespace(t=np.array(times))
    assert _bounds(nodes, 2) == wanted
