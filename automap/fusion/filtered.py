"""What the forward filter alone knew after each update."""

from __future__ import annotations

import numpy as np

from automap.fusion import kernels
from automap.fusion.aside import Matrices
from automap.fusion.kernel_runs import AnyFloats, ForwardRun
from automap.fusion.layout import N_NAV
from automap.fusion.problem import Problem
from automap.fusion.stamp_error import reported_rows
from automap.records import FloatArray


def full_covariance(packed: FloatArray, n: int) -> FloatArray:
    """Symmetric matrices [k, n, n] of packed upper triangles [k, n (n + 1) / 2]."""
    out = np.empty((len(packed), n, n))
    rows, columns = np.triu_indices(n)
    out[:, rows, columns] = packed
    out[:, columns, rows] = packed
    return out


def filtered_states(
    problem: Problem, forward: ForwardRun
) -> tuple[FloatArray, FloatArray, AnyFloats | Matrices]:
    """The forward filter's own states [k, 10], parameters [k, n - 9] and covariance [k, r, r]
    of the reported rows after each update."""
    nominal, params = forward.store.nominal.copy(), forward.store.params.copy()
    kernels.apply_correction(nominal, params, forward.store.mean)
    return nominal, params, reported_cov(problem, forward)


def filtered_variances(problem: Problem, forward: ForwardRun) -> AnyFloats:
    """The filter's variances [k, n - 9] of the parameters after each update."""
    if forward.param_var is not None:
        return forward.param_var
    n = problem.model.size
    i = np.arange(N_NAV, n)
    return np.asarray(forward.store.cov[:, i * n - i * (i - 1) // 2])


def reported_cov(problem: Problem, forward: ForwardRun) -> AnyFloats | Matrices:
    """The filter's covariance [k, r, r] of the reported rows after each update."""
    if forward.cov is not None:
        return forward.cov
    rows = reported_rows(problem.model)
    n = problem.model.size
    low = np.minimum(rows[:, None], rows[None, :])
    high = np.maximum(rows[:, None], rows[None, :])
    # place of an element in the packed upper triangle
    return np.asarray(forward.store.cov[:, low * n - low * (low - 1) // 2 + high - low])
