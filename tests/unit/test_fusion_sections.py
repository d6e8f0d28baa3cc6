"""A drive filtered and smoothed in sections gives what it gives in one piece."""

from __future__ import annotations

import numpy as np
import pytest

from automap.fusion.kernel_runs import PathStates, run_forward, run_smoother
from automap.fusion.nodes import Shift
from automap.fusion.sections import filter_and_smooth
from tests.unit.test_fusion_smoother import _problem


@pytest.mark.parametrize("relinearise", [False, True])
@pytest.mark.parametrize("section", [37, 1000])
def test_sections_change_nothing(section: int, relinearise: bool) -> None:
    problem, forward, start = _problem(60.0, gate=1e-3)
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
