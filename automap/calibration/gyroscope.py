"""Bias, scale, misalignment and g-sensitivity of a gyro from the turns between rests.

The true rate in the accelerometer's axes is K @ signals, signals = (1, reading, specific
force): K holds bias, scale with misalignment, and minus the g-sensitivity. Two kinds of rows
determine it: gravity carried from one rest to the next by the gyro must arrive where the
accelerometer finds it (Tedaldi, Pretto and Menegatti, ICRA 2014; the g-sensitivity is ours),
and at rest the rate is zero. The Earth's turn is 0.004 deg/s and goes into the rests' noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.calibration.accelerometer import N_NINE, AccelFit, directions_of
from automap.calibration.gravity_kernel import N_SIGNALS, carry_direction
from automap.calibration.least_squares import KNOWN, Fit, fit_with_floor, half_widths
from automap.calibration.limits import OWN_AXIS, ROUGH_SD, TURN_HOLE_STEPS, TURN_SMOOTH_S
from automap.calibration.rest import Rest
from automap.errors import InputError
from automap.gates import sd_by_median
from automap.records import FloatArray, RawImu

_N = 3 * N_SIGNALS


@dataclass(frozen=True)
class Turn:
    """The samples from the last of one rest to the first of the next.

    ``signals`` [n, 7], ``dt`` [n - 1] s, ``start``, ``end`` [3] unit gravity directions in
    body axes, ``variance`` [3] of their difference from the noise of the two rests, of which
    the earlier is number ``first``.
    """

    signals: FloatArray
    dt: FloatArray
    start: FloatArray
    end: FloatArray
    variance: FloatArray
    first: int

    @property
    def seconds(self) -> float:
        """Duration of the turn."""
        return float(self.dt.sum())


@dataclass(frozen=True)
class GyroFit:
    """Calibration of a gyro: true = matrix (scale * reading + bias) - g_sensitivity @ force.

    ``scale`` [3] rad/s per reading unit, ``bias`` [3] rad/s, ``matrix`` [3, 3] with unit
    diagonal, ``g_sensitivity`` [3, 3] (rad/s)/(m/s^2). ``covariance`` [12, 12] or [21, 21] in
    the order scale, bias, matrix (xy xz yx yz zx zy), g_sensitivity by rows; ``half_width`` of
    the 95 % intervals, 1.96 sigmas, in that order. ``turn_errors`` [t] rad between carried and
    measured gravity, ``rest_rates`` [k, 3] rad/s left at rest. Leaving out any one turn changes a
    scale by no more than ``scale_change`` (relative), the matrix by no more than
    ``matrix_change``.
    """

    scale: FloatArray
    bias: FloatArray
    matrix: FloatArray
    g_sensitivity: FloatArray
    covariance: FloatArray
    half_width: FloatArray
    turn_errors: FloatArray
    rest_rates: FloatArray
    with_g: bool
    scale_change: float
    matrix_change: float

    @property
    def turn_rms(self) -> float:
        """RMS angle between carried and measured gravity, rad."""
        return float(np.sqrt(np.mean(self.turn_errors**2)))

    def apply(self, reading: FloatArray, force: FloatArray) -> FloatArray:
        """Angular rate [n, 3] rad/s of readings [n, 3] at specific forces [n, 3] m/s^2."""
        rate = (reading * self.scale + self.bias) @ self.matrix.T - force @ self.g_sensitivity.T
        return np.asarray(rate)


def turns_between(
    logs: list[RawImu], forces: list[FloatArray], rests: list[Rest], directions: FloatArray,
    direction_var: FloatArray, gravity: float,
) -> list[Turn]:  # fmt: skip
    """The turns between neighbouring rests of the same log, without holes in the recording.

    ``forces`` are the calibrated specific forces [n, 3] of each log; ``directions`` [k, 3] the
    unit directions at the rests with ``direction_var`` [k, 3].
    """
    turns = []
    for i in range(len(rests) - 1):
        first, second = rests[i], rests[i + 1]
        if first.log != second.log:
            continue
        log = logs[first.log]
        rows = slice(first.stop - 1, second.start + 1)
        dt = np.diff(log.t_ns[rows]) * 1e-9
        if dt.max() > TURN_HOLE_STEPS / log.rate_hz:
            continue
        turns.append(
            Turn(
                signals=_signals(log.gyro[rows], forces[first.log][rows], gravity),
                dt=dt,
                start=directions[i],
                end=directions[i + 1],
                variance=direction_var[i] + direction_var[i + 1],
                first=i,
            )
        )
    return turns


def _signals(gyro: FloatArray, force: FloatArray, gravity: float) -> FloatArray:
    return np.column_stack([np.ones(len(gyro)), gyro, force / gravity])


def fit_gyro(
    logs: list[RawImu],
    forces: list[FloatArray],
    rests: list[Rest],
    turns: list[Turn],
    accel: AccelFit,
    gravity: float,
    with_g: bool = False,
) -> GyroFit:
    """Fit 12 parameters, or 21 with g-sensitivity, to turns and rests.

    ``forces`` [n, 3] of each log are those that ``accel`` gives; its errors, common to all
    turns, are parameters of the fit beside the gyro's, known beforehand as its covariance says.

    Raises:
        InputError: the gyro does not follow the turns of gravity, so its axes are not those
            of the accelerometer.
    """
    offset = np.median([rest.gyro for rest in rests], axis=0)
    unit = np.maximum(np.concatenate([log.gyro - offset for log in logs]).std(axis=0), 1e-300)
    scaled = [_scaled(turn, offset, unit) for turn in turns]
    rest_forces = accel.apply(np.array([r.accel for r in rests]))
    rest_signals = _signals(
        (np.array([r.gyro for r in rests]) - offset) / unit, rest_forces, gravity
    )
    K = np.zeros((3, N_SIGNALS))
    K[:, 1:4] = _linear_start(logs, forces, offset, unit)
    guessed = other_axes(K[:, 1:4] / unit)
    if guessed:
        # a few turns leave an axis open to a first guess, not to the fit
        sheet = logs[0].gyro_scale
        usual = np.median(np.abs(np.diag(K[:, 1:4] / unit)))
        K[:, 1:4] = np.diag((np.full(3, usual) if sheet is None else sheet) * unit)
    used = np.zeros((3, N_SIGNALS), dtype=bool)
    used[:, : N_SIGNALS if with_g else 4] = True
    fit = _fit(scaled, rests, rest_signals, K, used, unit, directions_by(accel, rests))
    n, p = len(turns), int(used.sum())
    K[used] = fit.parameters[:p]
    fitted = other_axes(K[:, 1:4] / unit)
    if guessed and fitted:
        raise InputError(fitted)
    # what is left by the accelerometer's calibration as it stands
    missed = fit.residuals - fit.jacobian[:, p:] @ fit.parameters[p:]
    errors = 2.0 * np.arcsin(
        np.clip(0.5 * np.linalg.norm(missed[: 3 * n].reshape(-1, 3), axis=1), 0, 1)
    )
    left = fit.residuals[3 * n : 3 * (n + len(rests))].reshape(-1, 3)
    return _to_readings(fit, used, offset, unit, gravity, errors, left)


def directions_by(accel: AccelFit, rests: list[Rest]) -> FloatArray:
    """Change [k, 3, 9] of the directions at the rests by the accelerometer's errors.

    The errors are uncorrelated and have sigmas of one: ``accel.covariance`` by its principal axes.
    """
    sd = np.sqrt(np.diag(accel.covariance))
    size = np.where(sd > 0.0, sd, 1.0)
    part, axes = np.linalg.eigh(accel.covariance / np.outer(size, size))
    steps = (size[:, None] * axes * np.sqrt(np.maximum(part, 0.0))).T
    means = np.array([rest.accel for rest in rests])
    at = directions_of(accel, means)
    return np.stack([directions_of(_perturbed(accel, step), means) - at for step in steps], axis=2)


def _perturbed(accel: AccelFit, step: FloatArray) -> AccelFit:
    values = np.concatenate([accel.scale, accel.bias, accel.misalignment]) + step
    return replace(accel, scale=values[:3], bias=values[3:6], misalignment=values[6:])


def _scaled(turn: Turn, offset: FloatArray, unit: FloatArray) -> Turn:
    signals = turn.signals.copy()
    signals[:, 1:4] = (signals[:, 1:4] - offset) / unit
    return replace(turn, signals=signals)


def _fit(
    turns: list[Turn], rests: list[Rest], rest_signals: FloatArray, K: FloatArray,
    used: np.ndarray, unit: FloatArray, by: FloatArray,
) -> Fit:  # fmt: skip
    """The entries of ``K`` [3, 7] that are ``used``, then nine errors of the accelerometer, which
    change the directions at the rests by ``by`` [k, 3, 9]."""
    n, k, p = len(turns), len(rests), int(used.sum())
    m = 3 * (n + k)

    def model(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        full = np.zeros(_N)
        full[used.ravel()] = x[:p]
        now = full.reshape(3, N_SIGNALS)
        r = np.empty(m + N_NINE)
        J = np.zeros((m, _N))
        J_accel = np.zeros((m + N_NINE, N_NINE))
        end, sensitivity = np.empty(3), np.empty((3, 3, N_SIGNALS))
        for i, turn in enumerate(turns):
            rows = slice(3 * i, 3 * i + 3)
            rate = turn.signals @ now.T
            first, second = by[turn.first], by[turn.first + 1]
            start = turn.start + first @ x[p:]
            carry_direction(rate, turn.signals, turn.dt, start, end, sensitivity)
            r[rows] = end - turn.end - second @ x[p:]
            J[rows] = sensitivity.reshape(3, _N)
            J_accel[rows] = _carried(rate, turn) @ first - second
        r[3 * n : m] = (rest_signals @ now.T).ravel()
        r[m:] = x[p:]
        J_accel[m:] = np.eye(N_NINE)
        for a in range(3):
            J[3 * n + a :: 3, a * N_SIGNALS : (a + 1) * N_SIGNALS] = rest_signals
        J_gyro = np.vstack([J[:, used.ravel()], np.zeros((N_NINE, p))])
        return r, np.hstack([J_gyro, J_accel])

    gyro_var = np.array([r.gyro_var for r in rests])
    scale = np.abs(np.diag(K[:, 1:4])) / unit
    # the gyro's own noise turns the carried direction too
    density = np.median(gyro_var * np.array([[r.length_s] for r in rests]), axis=0) * scale**2
    turn_var = np.array([t.variance + density.mean() * t.seconds for t in turns])
    variance = np.concatenate([turn_var.ravel(), (gyro_var * scale**2).ravel(), np.ones(N_NINE)])
    group = np.repeat([0, 1, KNOWN], [3 * n, 3 * k, N_NINE])
    share = np.repeat([2.0 / 3.0, 1.0, 1.0], [3 * n, 3 * k, N_NINE])
    return fit_with_floor(model, np.append(K[used], np.zeros(N_NINE)), variance, group, share)


def _carried(rate: FloatArray, turn: Turn) -> FloatArray:
    """The rotation [3, 3] of directions through a turn at ``rate`` [n, 3]."""
    out, unused = np.empty((3, 3)), np.empty((3, 3, N_SIGNALS))
    for a in range(3):
        end = np.empty(3)
        carry_direction(rate, turn.signals, turn.dt, np.eye(3)[a], end, unused)
        out[:, a] = end
    return out


def _linear_start(
    logs: list[RawImu], forces: list[FloatArray], offset: FloatArray, unit: FloatArray
) -> FloatArray:
    """First value [3, 3] of scale and misalignment, with no knowledge of the sensor.

    While the sensor turns slowly the direction u of the smoothed specific force nearly obeys
    du/dt = u x (K c); over windows that is linear in K. Windows with other accelerations are
    weighed down by how badly they fit.
    """
    from scipy.ndimage import uniform_filter1d

    blocks, changes = [], []
    for log, force in zip(logs, forces, strict=True):
        window = max(3, round(TURN_SMOOTH_S * log.rate_hz)) | 1
        smooth = uniform_filter1d(force, window, axis=0)
        u = smooth / (np.linalg.norm(smooth, axis=1)[:, None] + 1e-300)
        c = (log.gyro - offset) / unit
        dt = np.diff(log.t_s, prepend=0.0)
        summed = np.cumsum(np.einsum("ni,nj->nij", u, c) * dt[:, None, None], axis=0)
        rows = np.arange(0, len(u) - window, window)
        moment = summed[rows + window] - summed[rows]
        block = np.zeros((len(rows), 3, 3, 3))
        for i, b, a in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            block[:, i, a] += moment[:, b]
            block[:, i, b] -= moment[:, a]
        blocks.append(block.reshape(-1, 9))
        changes.append((u[rows + window] - u[rows]).ravel())
    X, y = np.concatenate(blocks), np.concatenate(changes)
    weight: FloatArray = np.ones(len(y))
    solution: FloatArray = np.zeros(9)
    tiny = 1e-12 * np.eye(9) * np.sum(X**2)
    for _ in range(15):
        weighted = X * (weight**2)[:, None]
        solution = np.asarray(np.linalg.solve(weighted.T @ X + tiny, weighted.T @ y))
        r = y - X @ solution
        sd = sd_by_median(r) + 1e-12
        weight = 1.0 / np.sqrt(1.0 + (r / (ROUGH_SD * sd)) ** 2)
    return solution.reshape(3, 3)


def other_axes(matrix: FloatArray) -> str:
    """A sentence where a gyro axis turns gravity as another, or the opposite, axis would."""
    size = np.abs(matrix)
    strongest = size.argmax(axis=1)
    for a in range(3):
        b = int(strongest[a])
        if size[a, a] >= OWN_AXIS * size[a, b] and (matrix[a, a] > 0 or size[a, b] == 0.0):
            continue
        sign = "-" if matrix[a, b] < 0 else ""
        return (
            f"gravity turns about the accelerometer's {'xyz'[a]} axis as the gyro's "
            f"{sign}{'xyz'[b]} axis says; give both sensors' columns in the same right-handed axes."
        )
    return ""


def _to_readings(
    fit: Fit, used: np.ndarray, offset: FloatArray, unit: FloatArray,
    gravity: float, errors: FloatArray, left: FloatArray,
) -> GyroFit:  # fmt: skip
    """The contract's parameters, with covariance, from the ``used`` entries of K in centred and
    scaled signals, the first parameters of ``fit``."""
    with_g = bool(used[0, -1])
    slots = np.flatnonzero(used.ravel())

    def parameters(flat: FloatArray) -> FloatArray:
        full = np.zeros(_N)
        full[slots] = flat
        k = full.reshape(3, N_SIGNALS)
        M = k[:, 1:4] / unit
        scale = np.diag(M)
        # K = M (reading - offset) + k0 = matrix (scale reading + bias)
        matrix = M / scale
        bias = np.linalg.solve(matrix, k[:, 0] - M @ offset)
        parts = [scale, bias, matrix[~np.eye(3, dtype=bool)]]
        if with_g:
            parts.append((-k[:, 4:] / gravity).ravel())
        return np.concatenate(parts)

    p = len(slots)
    x = fit.parameters[:p]
    values = parameters(x)
    J = np.empty((len(values), len(x)))
    for j in range(len(x)):
        step = 1e-6 * max(abs(x[j]), 1e-3)
        up, down = x.copy(), x.copy()
        up[j] += step
        down[j] -= step
        J[:, j] = (parameters(up) - parameters(down)) / (2.0 * step)
    covariance = J @ fit.stated_covariance()[:p, :p] @ J.T
    moved = _without_each_turn(fit, len(errors))[:, :p] @ J.T
    matrix = np.eye(3)
    matrix[~np.eye(3, dtype=bool)] = values[6:12]
    return GyroFit(
        scale=values[:3],
        bias=values[3:6],
        matrix=matrix,
        g_sensitivity=values[12:].reshape(3, 3) if with_g else np.zeros((3, 3)),
        covariance=covariance,
        half_width=half_widths(covariance),
        turn_errors=errors,
        rest_rates=left,
        with_g=with_g,
        scale_change=float(np.abs(moved[:, :3] / values[:3]).max(initial=0.0)),
        matrix_change=float(np.abs(moved[:, 6:12]).max(initial=0.0)),
    )


def _without_each_turn(fit: Fit, turns: int) -> FloatArray:
    """Change [t, p] of the parameters when a turn is left out, to first order."""
    A, r = fit.jacobian / fit.sd[:, None], fit.residuals / fit.sd
    moved = np.empty((turns, A.shape[1]))
    for i in range(turns):
        rows = slice(3 * i, 3 * i + 3)
        part = A[rows] @ fit.covariance
        moved[i] = part.T @ np.linalg.solve(np.eye(3) - part @ A[rows].T, r[rows])
    return moved
