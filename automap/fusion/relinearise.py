"""Another model of the same drive: linearised about the path that was found before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.fusion.adapt import scale_nodes, scale_problem
from automap.fusion.dense_pieces import linearisation_states
from automap.fusion.kernel_runs import PathStates, SmoothRun, Start
from automap.fusion.layout import N_NAV
from automap.fusion.levels import LEVELS
from automap.fusion.limits import MOST_REPEATS, SETTLED_TURN_RAD
from automap.fusion.nodes import Shift
from automap.fusion.passes import Pass, Session, converged, next_shift, nodes_of, problem_of
from automap.fusion.problem import Problem
from automap.fusion.sections import filter_and_smooth
from automap.records import FloatArray


def relinearise(session: Session, earlier: Pass, start: Start) -> tuple[Pass, Start]:
    """Filter and smooth a session whose drive has been smoothed under another model.

    Linearised about the path of the ``earlier`` pass, with the vehicle constraint, and about its
    own until neither the attitude nor the delays move. Noise levels are those of the session's
    options. Returned with the pass is the start that the next may have: ``start`` is as unsure
    as before.
    """
    options = session.options
    factors = dict.fromkeys(LEVELS, 1.0) | dict(options.factors)
    problem = scale_problem(problem_of(session), factors)
    smooth, before = _with_parameters_of(problem, earlier), earlier.shift
    shift = before if options.retime else Shift(before.delay_s, wheels_s=before.wheels_s)
    for _ in range(MOST_REPEATS):
        speed = np.hypot(smooth.nominal[:, 3], smooth.nominal[:, 4])
        nodes = nodes_of(session, problem, shift, smooth.nodes.t, speed, constrained=True)
        linearised_at = linearisation_states(problem, smooth, nodes, before, shift)
        start = Start(linearised_at.nominal[0].copy(), start.sd)
        nodes = scale_nodes(nodes, factors)
        forward, smooth = filter_and_smooth(
            *(problem, nodes, start, shift, linearised_at),
            section_nodes=session.section_nodes,
        )
        last = Pass(problem, nodes, forward, smooth, shift, factors)
        following = next_shift(problem.model, smooth, shift, options.retime)
        turned_little = _largest_turn(linearised_at, smooth) <= SETTLED_TURN_RAD
        if turned_little and converged(problem.model, smooth, following, shift):
            break
        before, shift = shift, following
    return last, Start(smooth.nominal[0].copy(), start.sd)


def _with_parameters_of(problem: Problem, earlier: Pass) -> SmoothRun:
    """The smoothed states of an earlier pass with the parameters of another model: those that it
    did not have at their priors."""
    model = problem.model
    params = np.tile(model.prior_mean, (len(earlier.smooth.params), 1))
    place = {name: i for i, name in enumerate(model.names)}
    for i, name in enumerate(earlier.problem.model.names):
        if name in place:
            params[:, place[name]] = earlier.smooth.params[:, i]
    assert params.shape[1] == model.size - N_NAV
    return replace(earlier.smooth, params=params)


def _largest_turn(linearised_at: PathStates, smooth: SmoothRun) -> float:
    """Largest angle in rad between the attitudes of two paths at the same nodes."""
    a: FloatArray = linearised_at.nominal[:, 6:10]
    b: FloatArray = smooth.nominal[:, 6:10]
    cosine = np.abs(np.einsum("ni,ni->n", a, b))
    # the sine of the half angle keeps its digits where the angle is small
    sine = np.sqrt(np.maximum(1.0 - np.minimum(cosine, 1.0) ** 2, 0.0))
    return 2.0 * float(np.arcsin(np.minimum(sine.max(initial=0.0), 1.0)))
