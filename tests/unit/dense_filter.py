"""A textbook Kalman filter and Rauch-Tung-Striebel smoother: the oracle of the fusion's.

No formula of the fusion is in here. Motion is integrated by Runge-Kutta on the rotating
ellipsoid, every derivative is a difference quotient, places are told apart by pymap3d, and the
filter works with full matrices on all measurements of an instant at once (Gelb, Applied Optimal
Estimation, 1974, chapters 4 and 5). The error state has the product's conventions: position,
velocity, attitude in NED, truth minus estimate, then the parameters by name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pymap3d
from scipy.integrate import trapezoid
from scipy.spatial.transform import Rotation

from automap.earth import gravity
from automap.records import FloatArray

EARTH_RATE = 7.292115e-5
N_NAV = 9


@dataclass(frozen=True)
class State:
    """A batch of states: ``place`` [b, 3] latitude, longitude, height, ``vel`` [b, 3] NED,
    ``c`` [b, 3, 3] sensor to NED, ``par`` [b, m]."""

    place: FloatArray
    vel: FloatArray
    c: FloatArray
    par: FloatArray

    def moved(self, dx: FloatArray) -> State:
        """The one state of this batch moved by errors [b, n]."""
        lat, _, height = self.place[0]
        north, east = _radii(lat)
        step = np.array([1 / (north + height), 1 / ((east + height) * np.cos(lat)), -1.0])
        turn = Rotation.from_rotvec(dx[:, 6:9]).as_matrix()
        return State(
            self.place + dx[:, 0:3] * step,
            self.vel + dx[:, 3:6],
            turn @ self.c,
            self.par + dx[:, N_NAV:],
        )

    def minus(self, other: State) -> FloatArray:
        """Errors [b, n] of this batch relative to one state."""
        metres = pymap3d.geodetic2ned(*self.place.T, *other.place[0], deg=False)
        turn = Rotation.from_matrix(self.c @ other.c[0].T).as_rotvec()
        parts = [np.stack(metres, axis=1), self.vel - other.vel, turn, self.par - other.par]
        return np.concatenate(parts, axis=1)


def _radii(lat: FloatArray) -> tuple[FloatArray, FloatArray]:
    meridian = pymap3d.rcurve.meridian(lat, deg=False)
    return meridian, pymap3d.rcurve.transverse(lat, deg=False)


def cross_matrix(w: FloatArray) -> FloatArray:
    """[w x] [..., 3, 3]."""
    zero = np.zeros_like(w[..., 0])
    rows = [[zero, -w[..., 2], w[..., 1]], [w[..., 2], zero, -w[..., 0]],
            [-w[..., 1], w[..., 0], zero]]  # fmt: skip
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rates_of_motion(
    place: FloatArray, vel: FloatArray, c: FloatArray, rate: FloatArray, force: FloatArray,
    earth_rate: float = EARTH_RATE,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Rates of change of place, velocity and attitude on the rotating ellipsoid (Groves, 5.4)."""
    lat, height = place[:, 0], place[:, 2]
    meridian, transverse = _radii(lat)
    north, east = meridian + height, transverse + height
    earth = earth_rate * np.stack([np.cos(lat), 0.0 * lat, -np.sin(lat)], axis=1)
    zero = np.zeros_like(lat)
    carried = np.stack(
        [vel[:, 1] / east, -vel[:, 0] / north, -vel[:, 1] * np.tan(lat) / east], axis=1
    )
    down = np.stack([zero, zero, gravity(lat, height)], axis=1)
    change = np.einsum("bij,bj->bi", c, force) + down - np.cross(2.0 * earth + carried, vel)
    turning = c @ cross_matrix(rate) - cross_matrix(earth + carried) @ c
    way = np.stack([vel[:, 0] / north, vel[:, 1] / (east * np.cos(lat)), -vel[:, 2]], axis=1)
    return way, change, turning


@dataclass(frozen=True)
class Readings:
    """Readings ``gyro``, ``accel`` [n, 3] at ``t`` [n], linear between, and those without noise,
    ``calm_gyro``, ``calm_accel`` [n, 3], that lever arms and scale errors take."""

    t: FloatArray
    gyro: FloatArray
    accel: FloatArray
    calm_gyro: FloatArray
    calm_accel: FloatArray

    def at(self, t: float, values: FloatArray) -> FloatArray:
        """Values [n, 3] between the samples."""
        return np.array([np.interp(t, self.t, column) for column in values.T])


@dataclass(frozen=True)
class Seen:
    """What is measured at one instant: its ``channels`` in order (constraints are measured to be
    zero), the ``variance`` of each, ``fix`` latitude, longitude, height, the accuracy that fixes
    state [3] m and what ``keep`` [3] of their lasting errors outlasts the last change of that."""

    t: float
    channels: Sequence[str]
    variance: Mapping[str, float]
    fix: FloatArray
    velocity: FloatArray
    speed: float
    stated_sd: FloatArray
    keep: FloatArray


@dataclass
class Trace:
    """What the filter leaves at every instant: states and covariances after its update,
    ``cov_before`` it, the ``transition`` to it from the instant before (one less), the
    ``correction`` made, and its scalars' innovations with their variances."""

    state: list[State] = field(default_factory=list)
    cov: list[FloatArray] = field(default_factory=list)
    cov_before: list[FloatArray] = field(default_factory=list)
    transition: list[FloatArray] = field(default_factory=list)
    correction: list[FloatArray] = field(default_factory=list)
    innovation: list[FloatArray] = field(default_factory=list)
    innovation_var: list[FloatArray] = field(default_factory=list)
    score: float = 0.0


@dataclass(frozen=True)
class DenseFilter:
    """The filter of one problem.

    ``names`` of the parameters, ``tau`` and ``walk`` by name (correlation time s with variance;
    growth of variance in a second), ``noise`` PSD of force and rate.
    """

    readings: Readings
    names: tuple[str, ...]
    tau: Mapping[str, float]
    walk: Mapping[str, float]
    noise: tuple[float, float]

    def _triple(self, par: FloatArray, effect: str, parts: Sequence[str] = "xyz") -> FloatArray:
        """Parameters [b, 3] of an effect, zero where it is none."""
        out = np.zeros((len(par), 3))
        for a, part in enumerate(parts):
            if f"{effect}_{part}" in self.names:
                out[:, a] = par[:, self.names.index(f"{effect}_{part}")]
        return out

    def _one(self, par: FloatArray, name: str) -> FloatArray:
        return par[:, self.names.index(name)] if name in self.names else np.zeros(len(par))

    def _true(self, par: FloatArray, values: FloatArray, sensor: str) -> FloatArray:
        """What the sensor would read without its errors: reading = true (1 + scale) + bias."""
        scale = self._triple(par, f"{sensor}_scale")
        return (values - self._triple(par, f"{sensor}_bias")) / (1.0 + scale)

    def _felt(self, par: FloatArray, t: float, sensor: str) -> FloatArray:
        """The true readings at an instant, of which only what is calm changes with ``par``."""
        noisy, calm = (
            self.readings.at(t, getattr(self.readings, name)) for name in (sensor, f"calm_{sensor}")
        )
        own = par[:1]
        change = self._true(par, calm, sensor) - self._true(own, calm, sensor)
        return self._true(own, noisy, sensor) + change

    def _steps(self) -> FloatArray:
        """Steps [n] of the difference quotients."""
        size = {"accel_bias": 1e-3, "gyro_bias": 1e-5, "gyro_scale": 1e-4, "accel_scale": 1e-4}
        own = [next((s for e, s in size.items() if n.startswith(e)), 1e-3) for n in self.names]
        return np.array([1.0] * 3 + [0.1] * 3 + [1e-4] * 3 + own)

    def _step(self, state: State, t0: float, t1: float) -> State:
        """Runge and Kutta's fourth order over a piece in which readings are linear."""
        ends = [
            (self._felt(state.par, t, "gyro"), self._felt(state.par, t, "accel")) for t in (t0, t1)
        ]
        middle = tuple(0.5 * (a + b) for a, b in zip(*ends, strict=True))
        h = t1 - t0

        def ahead(slope: tuple[FloatArray, ...], part: float) -> tuple[FloatArray, ...]:
            own = (state.place, state.vel, state.c)
            return tuple(x + part * h * d for x, d in zip(own, slope, strict=True))

        k1 = rates_of_motion(state.place, state.vel, state.c, *ends[0])
        k2 = rates_of_motion(*ahead(k1, 0.5), *middle)
        k3 = rates_of_motion(*ahead(k2, 0.5), *middle)
        k4 = rates_of_motion(*ahead(k3, 1.0), *ends[1])
        mean = tuple((a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True))
        return State(*ahead(mean, 1.0), state.par)

    def _predict(
        self, state: State, cov: FloatArray, t0: float, t1: float, keep: FloatArray
    ) -> tuple[State, FloatArray, FloatArray]:
        n = cov.shape[0]
        inside = self.readings.t[(self.readings.t > t0) & (self.readings.t < t1)]
        pieces = np.concatenate([[t0], inside, [t1]])
        eps = np.diag(self._steps())
        total = np.eye(n)
        for a, b in pairwise(pieces):
            batch = np.concatenate([np.zeros((1, n)), eps, -eps])
            ends = self._step(state.moved(batch), a, b)
            after = State(ends.place[:1], ends.vel[:1], ends.c[:1], ends.par[:1])
            miss = ends.minus(after)
            f = ((miss[1 : n + 1] - miss[n + 1 :]) / (2 * np.diag(eps))[:, None]).T
            noise = np.zeros(n)
            noise[3:6], noise[6:9] = self.noise[0] * (b - a), self.noise[1] * (b - a)
            cov = f @ cov @ f.T + np.diag(noise)
            total, state = f @ total, after
        # the parameters keep still within the interval and move at its end
        decay, grown = np.ones(n), np.zeros(n)
        for j, name in enumerate(self.names):
            if name in self.tau:
                d = np.exp(-(t1 - t0) / self.tau[name])
                if name.startswith(("gnss_correlated_noise", "gnss_multipath")):
                    d *= keep["ned".index(name[-1])]
                decay[N_NAV + j], grown[N_NAV + j] = d, (1.0 - d * d) * self.walk[name]
            else:
                grown[N_NAV + j] = self.walk.get(name, 0.0) * (t1 - t0)
        last = np.diag(decay)
        state = State(state.place, state.vel, state.c, state.par * decay[N_NAV:])
        return state, last @ cov @ last + np.diag(grown), last @ total

    def _mean_rate(self, par: FloatArray, t0: float, t1: float) -> FloatArray:
        r = self.readings
        inside = r.t[(r.t > t0) & (r.t < t1)]
        t = np.concatenate([[t0], inside, [t1]])
        values = np.stack([r.at(x, r.gyro) for x in t])
        return self._true(par, (trapezoid(values, t, axis=0) / (t1 - t0))[None], "gyro")

    def expected(self, state: State, seen: Seen, about: State, t0: float) -> dict[str, FloatArray]:
        """What the states [b] let expect of every channel, positions in metres from ``about``.

        Turn rate, acceleration and how fast the antenna moves at the instant are taken as known,
        as of ``about``.
        """
        r, par = self.readings, state.par
        rate = self._true(about.par, r.at(seen.t, r.calm_gyro)[None], "gyro")
        force = self._true(about.par, r.at(seen.t, r.calm_accel)[None], "accel")
        place = about.place[0]
        acceleration = (about.c[0] @ force[0]) + [0.0, 0.0, float(gravity(place[0], place[2]))]
        mount, lever, arm = self._installation(par)
        turned, near_lever, near_arm = (x[0] for x in self._installation(about.par))
        swing = np.cross(rate[0], near_lever)
        moving = about.vel[0] + about.c[0] @ swing
        drawn = acceleration + about.c[0] @ np.cross(rate[0], swing)
        late = self._one(par, "imu_time_offset_s") - self._one(par, "gnss_latency_s")
        late = (late + seen.t * self._one(par, "imu_clock_skew_skew"))[:, None]
        age = self._one(par, "gnss_velocity_latency_s") + self._one(par, "gnss_velocity_lag_tau")
        metres = np.stack(pymap3d.geodetic2ned(*state.place.T, *place, deg=False), axis=1)
        position = metres + np.einsum("bij,bj->bi", state.c, lever) + moving * late
        for lasting in ("gnss_correlated_noise", "gnss_multipath"):
            position = position + seen.stated_sd * self._triple(par, lasting, "ned")
        position = position + self._triple(par, "gnss_datum_shift", "ned")
        velocity = state.vel + np.einsum("bij,bj->bi", state.c, np.cross(rate, lever))
        velocity = velocity + drawn * (late - age[:, None])
        velocity = velocity + self._turned_back(par, moving, drawn)
        longer = 1.0 + self._one(par, "gnss_velocity_scale_relative")
        velocity = velocity * np.stack([longer, longer, np.ones(len(par))], axis=1)
        velocity = velocity + self._triple(par, "gnss_velocity_wander", "ned")
        own = np.einsum("bji,bj->bi", state.c, state.vel)
        along = np.einsum("bij,bj->bi", mount, own + np.cross(rate, arm))
        body = turned @ about.c[0].T @ acceleration
        forward = (turned @ (about.c[0].T @ about.vel[0] + np.cross(rate[0], near_arm)))[0]
        drift = self._one(par, "vehicle_sideslip_coefficient") * body[1] * forward
        nose = self._one(par, "vehicle_pitch_coefficient") * body[0] * forward
        lat = state.place[:, 0]
        earth = EARTH_RATE * np.stack([np.cos(lat), 0 * lat, -np.sin(lat)], axis=1)
        still = self._mean_rate(par, t0, seen.t) - np.einsum("bji,bj->bi", state.c, earth)
        out = {f"position_{a}": position[:, i] for i, a in enumerate("ned")}
        out |= {f"velocity_{a}": velocity[:, i] for i, a in enumerate("ned")}
        out |= {"nhc_y": along[:, 1] + drift, "nhc_z": along[:, 2] - nose}
        out |= {f"zupt_{a}": state.vel[:, i] for i, a in enumerate("ned")}
        out |= {f"zaru_{a}": still[:, i] for i, a in enumerate("xyz")}
        gained = acceleration - np.cross(about.c[0] @ rate[0], about.vel[0])
        wheels_late = late[:, 0] + self._one(par, "gnss_latency_s")
        wheels_late = wheels_late - self._one(par, "odometer_time_offset_s")
        told = along[:, 0] + (turned @ about.c[0].T @ gained)[0] * wheels_late
        out["odometer"] = (1.0 + self._one(par, "odometer_scale_relative")) * told
        return out

    def _turned_back(self, par: FloatArray, moving: FloatArray, drawn: FloatArray) -> FloatArray:
        """By how much a velocity [b, 3] differs whose course is old: it is turned back by the
        course's rate (v x a) / v^2, at less than 1 m/s by the less the slower it is."""
        square = float(moving[:2] @ moving[:2])
        rate = (moving[0] * drawn[1] - moving[1] * drawn[0]) / max(square, 1e-12)
        angle = -self._one(par, "gnss_course_latency_s") * rate * min(square, 1.0)
        return angle[:, None] * np.array([-moving[1], moving[0], 0.0])

    def _installation(self, par: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Mounting [b, 3, 3] sensor to vehicle, and the arms [b, 3] to the antenna and to the point
        that does not slide, which are stated along the vehicle's axes, along the sensor's."""
        angles = self._triple(par, "imu_mounting", ("yaw", "pitch", "roll"))
        mount = Rotation.from_euler("ZYX", angles).as_matrix()
        arms = (self._triple(par, effect) for effect in ("gnss_lever_arm", "nhc_lever_arm"))
        return (mount, *(np.einsum("bji,bj->bi", mount, arm) for arm in arms))

    def _update(self, trace: Trace, state: State, cov: FloatArray, seen: Seen, t0: float) -> State:
        n = cov.shape[0]
        trace.cov_before.append(cov)
        if not seen.channels:
            trace.correction.append(np.zeros(n))
            trace.state.append(state)
            trace.cov.append(cov)
            return state
        fix = pymap3d.geodetic2ned(*seen.fix, *state.place[0], deg=False)
        told = dict.fromkeys(seen.channels, 0.0)
        told |= {f"position_{a}": float(v) for a, v in zip("ned", fix, strict=True)}
        told |= {f"velocity_{a}": float(v) for a, v in zip("ned", seen.velocity, strict=True)}
        told["odometer"] = seen.speed
        eps = np.diag(self._steps())
        batch = state.moved(np.concatenate([np.zeros((1, n)), eps, -eps]))
        expected = self.expected(batch, seen, state, t0)
        rows = np.stack([expected[c] for c in seen.channels], axis=1)
        h = ((rows[1 : n + 1] - rows[n + 1 :]) / (2 * np.diag(eps))[:, None]).T
        z = np.array([told[c] for c in seen.channels]) - rows[0]
        s = h @ cov @ h.T + np.diag([seen.variance[c] for c in seen.channels])
        gain = np.linalg.solve(s, h @ cov).T
        dx = gain @ z
        keep = np.eye(n) - gain @ h
        after = keep @ cov @ keep.T
        after += gain @ np.diag([seen.variance[c] for c in seen.channels]) @ gain.T
        # one after another, each given those before: the factors of s
        low = np.linalg.cholesky(s)
        unit = low / np.diag(low)
        trace.innovation.append(np.linalg.solve(unit, z))
        trace.innovation_var.append(np.diag(low) ** 2)
        trace.score -= 0.5 * float(z @ np.linalg.solve(s, z) + np.linalg.slogdet(s)[1])
        trace.correction.append(dx)
        state = state.moved(dx[None])
        trace.state.append(state)
        trace.cov.append(after)
        return state

    def run(self, state: State, cov: FloatArray, instants: Sequence[Seen]) -> Trace:
        """Filter from the first instant to the last."""
        trace = Trace()
        before = instants[0].t
        for k, seen in enumerate(instants):
            if k:
                state, cov, f = self._predict(state, cov, before, seen.t, seen.keep)
                trace.transition.append(f)
            state = self._update(trace, state, cov, seen, before)
            cov, before = trace.cov[-1], seen.t
        return trace


def smooth(trace: Trace) -> tuple[list[State], list[FloatArray]]:
    """States and covariances given all measurements (Rauch, Tung, Striebel, 1965)."""
    k = len(trace.state)
    states, covs = list(trace.state), list(trace.cov)
    shift = np.zeros(len(covs[-1]))
    for i in range(k - 2, -1, -1):
        before, f = trace.cov_before[i + 1], trace.transition[i]
        scale = np.sqrt(np.diag(before))
        scaled = before / np.outer(scale, scale)
        g = np.linalg.solve(scaled, (f @ trace.cov[i]) / scale[:, None]).T / scale
        shift = g @ (trace.correction[i + 1] + shift)
        covs[i] = trace.cov[i] + g @ (covs[i + 1] - before) @ g.T
        states[i] = trace.state[i].moved(shift[None])
    return states, covs
