"""A drive filtered and smoothed in sections gives what it gives in one piece."""

from __future__ import annotations

from dataclasses import replace
from tempfile import TemporaryFile
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from automap.fusion import dense_pieces as pieces
from automap.fusion import engine
from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.filtered import filtered_states
from automap.fusion.kernel_runs import PathStates, run_dense, run_forward, run_smoother
from automap.fusion.nodes import Shift
from automap.fusion.options import FusionOptions
from automap.fusion.problem import stored
from automap.fusion.result import Prior
from automap.fusion.sections import _bounds, _on_springs, filter_and_smooth
from tests.unit.fusion_drive import CLOCK, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive
from tests.unit.test_fusion_smoother import _problem


@pytest.mark.parametrize("relinearise", [False, True])
@pytest.mark.parametrize("section", [11, 1000])
def test_sections_change_nothing(section: int, relinearise: bool) -> None:
    problem, forward, start = _problem(20.0, gate=1e-3)
    nodes = forward.nodes
    whole = run_smoother(problem, forward)
    about = PathStates(whole.nominal, whole.params) if relinearise else None
    held = nodes if about is None else _on_springs(problem, nodes, about, [0, len(nodes.t) - 1])[0]
    one = run_forward(problem, held, start, Shift(), linearised_at=about)
    whole = run_smoother(problem, one)
    run, smooth = filter_and_smooth(
        problem, nodes, start, Shift(), linearised_at=about, section_nodes=section
    )
    assert (run.cov is not None) == (section < len(nodes.t))
    assert run.score == pytest.approx(one.score, rel=1e-9)
    filtered = zip(
        filtered_states(problem, run)[:2], filtered_states(problem, one)[:2], strict=True
    )
    told = ((getattr(run.store, name), getattr(one.store, name)) for name in ("nu", "var"))
    for ours, theirs in (*filtered, *told):
        assert ours == pytest.approx(theirs, rel=1e-7, abs=1e-8)
    assert np.array_equal(run.store.scalars, one.store.scalars)
    assert np.array_equal(run.store.info, one.store.info)
    sd = np.sqrt(np.einsum("kii->ki", whole.cov))[:, :9]
    metres = np.array([6.4e6, 5.2e6, 1.0])
    assert np.abs((smooth.nominal - whole.nominal)[:, :3] * metres / sd[:, :3]).max() < 1e-4
    assert np.abs((smooth.nominal - whole.nominal)[:, 3:6] / sd[:, 3:6]).max() < 1e-4
    scale = sd[:, :, None] * sd[:, None, :]
    assert np.abs((smooth.cov - whole.cov)[:, :9, :9] / scale).max() < 1e-5
    assert smooth.params == pytest.approx(whole.params, rel=1e-5, abs=1e-8)


def test_states_to_linearise_about_are_the_same_stretch_by_stretch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem, forward, _ = _problem(20.0, gate=1e-3)
    smooth = run_smoother(problem, forward)
    # as where a delay was found: between other samples, and beyond the ends
    nodes = replace(smooth.nodes, t=smooth.nodes.t + 0.013)
    whole = pieces.linearisation_states(problem, smooth, nodes, Shift(), Shift(0.013))
    monkeypatch.setattr(pieces, "PIECE_ROWS", 97)
    parts = pieces.linearisation_states(problem, smooth, nodes, Shift(), Shift(0.013))
    assert np.array_equal(parts.nominal, whole.nominal)
    assert np.array_equal(parts.params, whole.params)


def test_samples_in_a_file_change_nothing() -> None:
    problem, forward, start = _problem(20.0, gate=1e-3)
    nodes, whole = forward.nodes, run_smoother(problem, forward)
    with TemporaryFile() as file:
        far = stored(problem, file)
        run, smooth = filter_and_smooth(far, nodes, start, Shift(), section_nodes=11)
        near, beside = filter_and_smooth(problem, nodes, start, Shift(), section_nodes=11)
        assert run.score == near.score
        for one, other in ((run.cov, near.cov), (smooth.cov, beside.cov)):
            assert one is not None
            assert other is not None
            assert np.array_equal(one[:], other)
            assert np.array_equal(one[3:17], other[3:17])
        assert np.array_equal(run.store.mean, near.store.mean)
        ours, theirs = (pieces.dense_pieces(p, nodes, whole, True, 0.5) for p in (far, problem))
        for one, other in zip(ours, theirs, strict=True):
            assert np.array_equal(one.dense, other.dense)
    assert len(smooth.nominal) == len(nodes.t)


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


def test_a_long_drive_is_fused_as_a_short_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """With samples in a file and in stretches, the sensor's axes unknown."""
    motion = city_drive(60.0, 4)
    imu, fixes = record(motion, Sensor(), 4, rate=50.0), receive(motion, Receiver(), 5)
    imu = replace(imu, axes_known=False)
    given = imu, fixes, CLOCK, FusionOptions(tune=False, adapt=False), Prior(0.0, 0.05)
    whole = fuse_imu_gnss(*given)
    monkeypatch.setattr(pieces, "PIECE_ROWS", 1100)
    monkeypatch.setattr(engine, "ROWS", 1100)
    with TemporaryFile() as file:
        long = fuse_imu_gnss(*given, scratch=file)
        for one, other in ((long.trajectory, whole.trajectory), (long.filtered, whole.filtered)):
            for name, values in vars(other).items():
                assert np.array_equal(vars(one)[name], values), name
    assert np.array_equal(long.mounting.matrix, whole.mounting.matrix)


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
