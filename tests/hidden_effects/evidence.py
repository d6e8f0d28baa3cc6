"""How much evidence a drive carries for an error, by an optimal linear estimator.

An error that the base model does not hold shifts readings and fixes by known amounts. What the
base model's filter cannot absorb remains in its whitened innovations; half their sum of
squares is the expected gain in log-likelihood of naming the error. The filter is linear, about
the true motion, in north, east, down error states: position, velocity, attitude, biases, scale
factors and the receiver's wander. It knows the noise that was really drawn.

Reference: A. Willsky, H. Jones, A generalized likelihood ratio approach to the detection and
estimation of jumps in linear systems, IEEE TAC 21 (1976); Groves, 2nd edition, section 14.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.hidden_effects.extras import NOTHING, Extras
from tests.hidden_effects.geodesy import Array, earth_rate_ned
from tests.hidden_effects.gnss import GnssRecord, record_gnss
from tests.hidden_effects.imu import Effects, ImuRecord, record_imu
from tests.hidden_effects.motion import Motion, State, to_body, to_nav
from tests.hidden_effects.noise import GnssNoise, ImuNoise

NHC_SD, NHC_SLIP = 0.04, 0.03
NHC_SPEED = 3.0
REST_SPEED_SD, REST_RATE_SD = 0.03, 1e-3
UNTOLD_SD = 1e3
"""m/s, of a velocity that the receiver does not tell."""
_P, _V, _A, _BA, _BG, _SA, _SG, _W = (slice(3 * i, 3 * i + 3) for i in range(8))
N_STATES = 24
PRIOR_SD = np.repeat([20.0, 2.0, 0.2, 0.15, 5e-3, 5e-3, 5e-3, 1.0], 3)


@dataclass(frozen=True)
class Shifts:
    """What errors do to a drive: ``accel``, ``gyro`` [n, 3, k] to the readings, ``pos``, ``vel``
    [m, 3, k] to the fixes, ``nhc`` [n, 2, k] m/s to the vehicle constraint, k cases."""

    accel: Array
    gyro: Array
    pos: Array
    vel: Array
    nhc: Array


@dataclass(frozen=True)
class Whitened:
    """Whitened innovations ``nu`` [r, k] of k cases, and ``log_det`` of their covariances."""

    nu: Array
    log_det: float

    def gram(self) -> Array:
        """Information [k, k] between the cases."""
        return np.asarray(self.nu.T @ self.nu)


@dataclass(frozen=True)
class Scene:
    """One drive as the estimator sees it: true ``state`` at the IMU's stamps [n], ``fix`` at the
    tags [m], the manifest's ``lever_arm``."""

    motion: Motion
    state: State
    fix: State
    tag: Array
    lever_arm: Array
    rate_hz: float


def make_scene(motion: Motion, tag: Array, lever_arm: Array, rate_hz: float = 100.0) -> Scene:
    """The ideal motion at the samples and at the fixes."""
    stamp = np.arange(round(motion.seconds * rate_hz) + 1) / rate_hz
    return Scene(motion, motion.at(stamp), motion.at(tag), tag, lever_arm, rate_hz)


def shifts_of(
    scene: Scene,
    cases: Sequence[Effects],
    warm_up: tuple[float, float, float],
    extras: Extras = NOTHING,
) -> Shifts:
    """Readings and fixes with each case's errors and no noise, less the ideal ones.

    What no library holds (``extras``) is added to every case.
    """
    silent_imu, silent_gnss = ImuNoise(0.0, 0.0), GnssNoise(0.0, 0.0, 60.0, 0.0)
    parts: list[tuple[Array, Array, Array, Array, Array]] = []
    state = scene.state
    for effects in cases:
        rng = np.random.default_rng(0)
        imu = record_imu(
            scene.motion,
            effects,
            silent_imu,
            rng,
            warm_up,
            extras.imu,
            scene.rate_hz,
            extras.readings,
            extras.clock,
        )
        gnss = record_gnss(
            scene.motion, effects, silent_gnss, rng, scene.lever_arm, extras.fix, scene.tag
        )
        gyro = imu.gyro - imu.clean_gyro
        if "earth_rotation" in effects:
            gyro = gyro + to_body(state.C_n_b, earth_rate_ned(state.lat))
        axle = np.array([effects.get("nhc_lever_arm", {}).get(axis, 0.0) for axis in "xyz"])
        nhc = np.cross(state.rate_nav, np.broadcast_to(axle, state.rate_nav.shape))[:, 1:]
        slip = sum(effects.get("vehicle_sideslip", {}).values())
        nhc[:, 0] += slip * state.rate_nav[:, 2] * state.speed**2
        if extras.body is not None:
            nose = extras.body(scene.motion.path_at(state.t))
            nhc += state.speed[:, None] * np.column_stack([nose[:, 2], -nose[:, 1]])
        if extras.nhc is not None:
            nhc += extras.nhc(scene.motion, state.t)
        parts.append((imu.accel - imu.clean_accel, gyro, gnss.error_pos, gnss.error_vel, nhc))
    return Shifts(*(np.stack(list(part), axis=-1) for part in zip(*parts, strict=True)))


def shifts_of_records(scene: Scene, imu: ImuRecord, gnss: GnssRecord) -> Shifts:
    """The errors that were really drawn, noise and all, as one case."""
    sideways = to_body(scene.state.C_n_b, scene.state.vel_ned)[:, 1:]
    return Shifts(
        (imu.accel - imu.clean_accel)[..., None],
        (imu.gyro - imu.clean_gyro)[..., None],
        gnss.error_pos[..., None],
        gnss.error_vel[..., None],
        -sideways[..., None],
    )


def whiten(
    scene: Scene,
    shifts: Shifts,
    imu: ImuNoise,
    gnss: GnssNoise,
    accel_walk: Array,
    gyro_walk: Array,
    without: Sequence[str] = (),
) -> Whitened:
    """Run the base model's filter over ``shifts``; ``accel_walk``, ``gyro_walk`` [3] densities
    of the in-run drift; ``without`` accel_scale or gyro_scale the filter takes those as exact."""
    blocks = _intervals(scene, shifts)
    k = shifts.pos.shape[-1]
    x = np.zeros((N_STATES, k))
    prior = PRIOR_SD.copy()
    axes = np.array([1.0, 1.0, gnss.vertical])
    prior[_W] = gnss.wander * axes + 1e-6
    for name, block in (("accel_scale", _SA), ("gyro_scale", _SG)):
        if name in without:
            prior[block] = 1e-9
    P = np.diag(prior**2)
    pos_sd, vel_sd = gnss.white * axes, np.hypot(gnss.velocity, gnss.velocity_wander) * axes
    nus: list[Array] = []
    log_det = 0.0
    # the receiver's resolution
    pos_var, vel_var = pos_sd**2 + 1e-8, vel_sd**2 + 1e-7
    if not gnss.down_known:
        vel_var[2] = UNTOLD_SD**2
    for i, dt in enumerate(blocks.dt):
        F = blocks.transition(i)
        keep = np.exp(-dt / gnss.wander_s)
        F[_W, _W] = keep * np.eye(3)
        x = F @ x
        x[_V] += blocks.u_v[i]
        x[_P] += 0.5 * dt * blocks.u_v[i]
        x[_A] += blocks.u_a[i]
        P = F @ P @ F.T
        noise = np.zeros(N_STATES)
        noise[_V] = (imu.accel**2 + imu.accel_lsb**2 / 1200.0) * dt
        noise[_A] = (imu.gyro**2 + imu.gyro_lsb**2 / 1200.0) * dt
        noise[_BA], noise[_BG] = accel_walk**2 * dt, gyro_walk**2 * dt
        noise[_W] = prior[_W] ** 2 * (1.0 - keep**2)
        P[np.diag_indices(N_STATES)] += noise
        H, y, R = _measurements(scene, shifts, blocks, i, pos_var, vel_var)
        S = H @ P @ H.T + np.diag(R)
        L = np.linalg.cholesky(S)
        nu = np.linalg.solve(L, y - H @ x)
        gain = np.linalg.solve(S, H @ P).T
        x = x + gain @ (y - H @ x)
        P = P - gain @ (H @ P)
        P = 0.5 * (P + P.T)
        nus.append(nu)
        log_det += 2.0 * float(np.log(np.diag(L)).sum())
    return Whitened(np.concatenate(nus), log_det)


@dataclass(frozen=True)
class _Intervals:
    """Integrals between fixes, and what holds over each second before it."""

    dt: Array
    C_dt: Array  # of C_n_b
    f_dt: Array  # of the specific force, navigation axes
    Cf_dt: Array
    Cw_dt: Array
    u_v: Array
    u_a: Array
    last: np.ndarray
    second: np.ndarray  # whether a whole second ends here

    def transition(self, i: int) -> Array:
        """State transition [N, N] over interval i, without the wander."""
        dt = self.dt[i]
        F = np.eye(N_STATES)
        F[_P, _V] = dt * np.eye(3)
        to_v = ((_A, _skew(self.f_dt[i])), (_BA, self.C_dt[i]), (_SA, self.Cf_dt[i]))
        for block, matrix in to_v:
            F[_V, block] = matrix
            F[_P, block] = 0.5 * dt * matrix
        F[_A, _BG], F[_A, _SG] = -self.C_dt[i], -self.Cw_dt[i]
        return F


def _intervals(scene: Scene, shifts: Shifts) -> _Intervals:
    state = scene.state
    edge = np.clip(np.rint(scene.tag * scene.rate_hz).astype(np.int64), 0, len(state.t) - 1)
    start = np.concatenate([[0], edge[:-1]])
    step = 1.0 / scene.rate_hz

    def integral(values: Array) -> Array:
        total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
        return np.asarray((total[edge] - total[start]) * step)

    C = state.C_n_b
    whole = np.floor(scene.tag + 1e-9)
    return _Intervals(
        dt=(edge - start) * step,
        C_dt=integral(C),
        f_dt=integral(to_nav(C, state.force)),
        Cf_dt=integral(C * state.force[:, None, :]),
        Cw_dt=integral(C * state.rate[:, None, :]),
        u_v=integral(np.einsum("nij,njk->nik", C, shifts.accel)),
        u_a=-integral(np.einsum("nij,njk->nik", C, shifts.gyro)),
        last=edge,
        second=np.diff(whole, prepend=0.0) > 0.0,
    )


def _measurements(
    scene: Scene, shifts: Shifts, blocks: _Intervals, i: int, pos_var: Array, vel_var: Array
) -> tuple[Array, Array, Array]:
    """Rows, values [r, k] and variances [r] of fix i and of the vehicle at that instant."""
    fix = scene.fix
    C = fix.C_n_b[i]
    rows = 6
    H = np.zeros((12, N_STATES))
    H[0:3, _P] = H[3:6, _V] = H[0:3, _W] = np.eye(3)
    H[0:3, _A] = _skew(C @ scene.lever_arm)
    y = [shifts.pos[i], shifts.vel[i]]
    R = [pos_var, vel_var]
    if blocks.second[i]:
        # means over the second, as a real filter takes them
        rate_hz = round(scene.rate_hz)
        last = int(blocks.last[i])
        span = slice(max(0, last - rate_hz), last + 1)
        speed = fix.speed[i]
        if speed > NHC_SPEED:
            lateral = abs(fix.rate_nav[i, 2] * speed)
            sideways = (C.T @ -_skew(fix.vel_ned[i]))[1:]
            H[6:8, _V], H[6:8, _A] = C.T[1:], sideways
            y.append(shifts.nhc[span].mean(axis=0))
            R.append(np.array([NHC_SD + NHC_SLIP * lateral, NHC_SD]) ** 2)
            rows = 8
        elif float(scene.state.speed[span].max()) < 1e-3:
            H[6:9, _V], H[9:12, _BG] = np.eye(3), np.eye(3)
            # a bias state takes away what the readings have too much
            y += [np.zeros_like(shifts.vel[i]), -shifts.gyro[span].mean(axis=0)]
            R += [np.full(3, REST_SPEED_SD**2), np.full(3, REST_RATE_SD**2)]
            rows = 12
    return H[:rows], np.concatenate(y), np.concatenate(R)


def _skew(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
