"""Attitude at the first instant, from gyro, specific force and the receiver's velocity.

Tilt comes from the integrated specific force in the starting body axes against the
receiver's velocity change minus gravity (optimisation-based alignment, Wu and Pan 2013).
Heading is not assumed: hypotheses all around the circle are run through the filter over the
first part of the drive and the likeliest wins. That covers a start at rest, in motion or in
reverse, and any mounting of the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap import earth
from automap.frames import matrix_to_quat, rotation_vector_to_matrix
from automap.fusion import limits
from automap.fusion.kernel_runs import Start, run_forward
from automap.fusion.nodes import FixModel, Nodes, Shift
from automap.fusion.problem import Problem
from automap.records import FloatArray


@dataclass(frozen=True)
class Alignment:
    """The chosen start, the log-likelihood margin over the next different heading (nats)."""

    start: Start
    margin: float


def start_state(
    problem: Problem, fixes: FixModel, t0: float, attitude: FloatArray, sd_attitude: FloatArray
) -> Start:
    """Start at the first fix's position and velocity with an attitude [3, 3]."""
    with_position = np.flatnonzero(fixes.flags & 1)
    first = int(with_position[0])
    has_height = np.flatnonzero(fixes.flags & 2)
    height = float(fixes.values[has_height[0], 2]) if len(has_height) else 0.0
    wait = abs(float(fixes.t[first]) - t0)
    with_velocity = np.flatnonzero(fixes.flags & 4)
    nominal = np.zeros(10)
    nominal[0:2] = fixes.values[first, 0:2]
    nominal[2] = height
    speed_sd = limits.UNKNOWN_SPEED_SD
    if len(with_velocity):
        row = int(with_velocity[0])
        wait_v = abs(float(fixes.t[row]) - t0)
        nominal[3:6] = fixes.values[row, 3:6]
        speed_sd = min(
            limits.START_SPEED_SD + limits.START_ACCELERATION * wait_v, limits.MOST_SPEED_SD
        )
        nominal[0] -= nominal[3] * wait / earth.A
        nominal[1] -= nominal[4] * wait / (earth.A * np.cos(nominal[0]))
    nominal[6:10] = matrix_to_quat(attitude)
    sd_position = first_position_sd(fixes, first) + limits.START_DRIFT * wait
    if len(has_height) == 0:
        sd_position[2] = limits.UNKNOWN_HEIGHT_SD_M
    sd = np.concatenate([sd_position, [speed_sd] * 3, sd_attitude])
    return Start(nominal, sd)


def first_position_sd(fixes: FixModel, first: int) -> FloatArray:
    """How unsure [3] m a position is that is told by one fix."""
    lasting = limits.START_WANDERS * fixes.whole_sd[first]
    return np.asarray(lasting + limits.START_SD_M + np.sqrt(fixes.white_var[first, :3]))


def level(
    problem: Problem, fixes: FixModel, t0: float, gyro_bias: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """An attitude [3, 3] at ``t0`` that explains the force, and the direction [3] it leaves free.

    In the starting body axes the specific force integrates to a; in NED it must integrate to
    b, the change of velocity minus gravity. Any turn about b is as good: that is the heading.
    Y. Wu, X. Pan, IEEE Transactions on Aerospace and Electronic Systems 49(2), 2013.
    """
    stop = min(t0 + limits.LEVELLING_WINDOW_S, float(problem.t[-1]))
    first, last = (int(k) for k in np.searchsorted(problem.t, [t0, np.nextafter(stop, np.inf)]))
    rows = slice(first, last) if last - first >= 2 else slice(0, 2)
    samples = problem.samples_at(rows)
    t = samples.t
    dt = np.minimum(np.diff(t, prepend=t[0]), 0.1)
    rate = samples.raw[:, :3] - gyro_bias
    force = samples.raw[:, 3:]
    turns = rotation_vector_to_matrix(rate * dt[:, None])
    turn = np.eye(3)
    total = np.zeros(3)
    for i in range(len(t)):
        turn = turn @ turns[i]
        total += turn @ force[i] * float(dt[i])
    target = np.array([0.0, 0.0, -9.8 * float(dt.sum())])
    near = (fixes.flags & 4 > 0) & (fixes.t >= t0 - 1.0) & (fixes.t <= t[-1] + 1.0)
    if int(near.sum()) >= 2 and fixes.t[near][-1] - fixes.t[near][0] > 0.5 * (t[-1] - t0):
        change = fixes.values[near][-1, 3:5] - fixes.values[near][0, 3:5]
        target[:2] = change * (t[-1] - t0) / (fixes.t[near][-1] - fixes.t[near][0])
    want = target / max(float(np.linalg.norm(target)), 1e-9)
    body = total / max(float(np.linalg.norm(total)), 1e-9)
    return _shortest_rotation(body, want), want


def align(
    problem: Problem,
    fixes: FixModel,
    nodes: Nodes,
    gyro_bias: FloatArray,
    shift: Shift,
) -> Alignment:
    """Choose the starting attitude by the likelihood of the first part of the drive."""
    t0 = float(nodes.t[0])
    tilt, free = level(problem, fixes, t0, gyro_bias)
    trial = nodes.first_moving(limits.TRIAL_MOVING_S, limits.TRIAL_MAX_S)
    step = 2.0 * np.pi / limits.N_HEADINGS
    sd_attitude = np.array(
        [limits.START_TILT_SD, limits.START_TILT_SD, limits.START_HEADING_SD * step]
    )
    runs = []
    for j in range(limits.N_HEADINGS):
        attitude = rotation_vector_to_matrix(j * step * free) @ tilt
        start = start_state(problem, fixes, t0, attitude, sd_attitude)
        score = run_forward(problem, trial, start, shift, store=False).score
        runs.append((score if np.isfinite(score) else -np.inf, j, start))
    runs.sort(key=lambda item: -item[0])
    best_score, best, start = runs[0]
    # neighbours converge to the same answer; the margin is against the others
    far = [
        s
        for s, j, _ in runs
        if min((j - best) % limits.N_HEADINGS, (best - j) % limits.N_HEADINGS) > 2
    ]
    margin = float(best_score - max(far))
    if margin < limits.SURE_MARGIN_NATS:
        # nothing tells the heading: say so
        start = Start(start.nominal, np.concatenate([start.sd[:8], [limits.UNKNOWN_HEADING_SD]]))
    return Alignment(start, margin)


def _shortest_rotation(source: FloatArray, target: FloatArray) -> FloatArray:
    """Matrix [3, 3] of the smallest rotation that takes a unit vector to another."""
    axis = np.cross(source, target)
    sine = float(np.linalg.norm(axis))
    cosine = float(source @ target)
    if sine < 1e-9:
        if cosine > 0:
            return np.eye(3)
        other = np.array([1.0, 0.0, 0.0]) if abs(source[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
        axis = np.cross(source, other)
        return rotation_vector_to_matrix(np.pi * axis / np.linalg.norm(axis))
    return rotation_vector_to_matrix(axis / sine * np.arctan2(sine, cosine))
