"""From fixes and standstill to nodes: what the filter observes, when, and how well."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from automap.fusion import limits
from automap.fusion.layout import (
    CH_POS,
    HAS_POS_H,
    HAS_POS_V,
    HAS_VEL_H,
    HAS_VEL_V,
    MAX_SCALARS,
    N_VALUES,
)
from automap.fusion.measurements.constraint import constrain
from automap.fusion.measurements.position import (
    has_position,
    hold_reported_sd,
    lasting_share,
    position_errors,
)
from automap.fusion.measurements.rest import note_rest
from automap.fusion.measurements.velocity import has_velocity, told_later, velocity_errors
from automap.fusion.measurements.wheel_speed import Odometer, note_wheels
from automap.fusion.options import FusionOptions
from automap.records import Fixes, FloatArray, IntArray


@dataclass(frozen=True)
class Shift:
    """What the nodes' times contain: IMU stamps late by ``delay_s`` against the fixes and running
    fast by ``skew`` s/s, fixes older than their tag by ``latency_s``, velocities older than the
    positions by ``vel_latency_s`` and by their low-pass, ``vel_lag_s``."""

    delay_s: float = 0.0
    vel_latency_s: float = 0.0
    latency_s: float = 0.0
    skew: float = 0.0
    vel_lag_s: float = 0.0
    wheels_s: float = 0.0
    course_s: float = 0.0

    def host_times(self, t: FloatArray) -> FloatArray:
        """Times on the IMU's axis of instants of the fixes' clock."""
        return np.asarray((t + self.delay_s) * (1.0 + self.skew))

    def wheel_times(self, t: FloatArray) -> FloatArray:
        """Times on the IMU's axis to which wheel speeds stamped ``t`` belong."""
        return self.host_times(t - self.wheels_s)

    def position_times(self, t: FloatArray) -> FloatArray:
        """Times on the IMU's axis to which positions tagged ``t`` belong."""
        return self.host_times(t - self.latency_s)

    @property
    def velocity_delay_s(self) -> float:
        """By how much velocities are older than positions."""
        return self.vel_latency_s + self.vel_lag_s


@dataclass(frozen=True)
class FixModel:
    """Fixes with the error model the filter uses.

    ``t`` [m] seconds on the IMU's time axis without any delay, ``flags`` [m], ``values`` [m, 6]
    latitude, longitude (rad), height, velocity NED, ``white_var`` [m, 6], ``stated_sd`` [m, 3],
    ``row`` [m] the fix's row in its table, ``larger`` [m, 2] by how much positions err more than
    is usual: by the whole of it, and by what lasts for seconds.
    """

    t: FloatArray
    flags: IntArray
    values: FloatArray
    white_var: FloatArray
    stated_sd: FloatArray
    row: IntArray
    larger: FloatArray

    @property
    def whole_sd(self) -> FloatArray:
        """Sigma [m, 3] m of all that lasts of positions."""
        return np.asarray(self.stated_sd * self.larger[:, :1])


@dataclass(frozen=True)
class Nodes:
    """The filter's nodes in time order; arrays as ``run_forward`` takes them.

    ``stated_sd`` [k, 3] goes with errors that last for minutes, ``quick_sd`` [k, 3] with those of
    seconds; ``fix_row`` [k] the row of the fix table that was used, -1 for none; ``lasting_keep``
    [k, 6] how much of the two, normalised, outlasts the step to a node where its size has changed.
    """

    t: FloatArray
    flags: IntArray
    values: FloatArray
    var: FloatArray
    stated_sd: FloatArray
    quick_sd: FloatArray
    fix_row: IntArray
    lasting_keep: FloatArray

    def first(self, count: int) -> Nodes:
        """The first nodes alone."""
        return self.between(0, count)

    def between(self, start: int, stop: int) -> Nodes:
        """The nodes from ``start`` to before ``stop``."""
        part = slice(start, stop)
        return Nodes(
            self.t[part],
            self.flags[part],
            self.values[part],
            self.var[part],
            self.stated_sd[part],
            self.quick_sd[part],
            self.fix_row[part],
            self.lasting_keep[part],
        )

    def first_moving(self, moving_s: float, most_s: float) -> Nodes:
        """The first nodes, until the vehicle was seen moving for ``moving_s`` seconds; no more
        than ``most_s`` seconds of them."""
        has = (self.flags & HAS_VEL_H) > 0
        speed = np.where(has, np.hypot(self.values[:, 3], self.values[:, 4]), 0.0)
        spacing = np.diff(self.t, prepend=self.t[0])
        travelled = np.cumsum(np.where(speed > limits.MOVING_SPEED, spacing, 0.0))
        enough = np.flatnonzero(travelled > moving_s)
        stop = int(enough[0]) if len(enough) else len(self.t)
        stop = min(stop, int(np.searchsorted(self.t, self.t[0] + most_s)))
        return self.first(max(stop, min(len(self.t), 2)))


def model_fixes(fixes: Fixes, t: FloatArray, options: FusionOptions) -> FixModel:
    """Give every usable fix its error model; ``t`` [n] are the fixes' times in s."""
    has_h, has_v = has_position(fixes)
    vel_h, vel_v = (has & np.isfinite(t) for has in has_velocity(fixes))
    flags = has_h * HAS_POS_H + has_v * HAS_POS_V + vel_h * HAS_VEL_H + vel_v * HAS_VEL_V
    use = np.isfinite(t) & (flags > 0)
    factor = np.ones(len(fixes))
    for fix_type, value in limits.FIX_TYPE_FACTOR.items():
        factor[fixes.fix_type == fix_type] = value
    sd, white = position_errors(fixes, factor, options)
    sd_vel = velocity_errors(fixes, factor, options)
    height = np.where(has_v, fixes.height_m, np.nan)
    values = np.column_stack([fixes.lat_rad, fixes.lon_rad, height, fixes.vel_ned])
    rows = np.flatnonzero(use)
    order = rows[np.argsort(t[rows], kind="stable")]
    return FixModel(
        t[order],
        flags[order].astype(np.int64),
        np.nan_to_num(values[order]),
        np.concatenate([white, sd_vel], axis=1)[order] ** 2,
        hold_reported_sd(sd[order]),
        order.astype(np.int64),
        np.ones((len(order), 2)),
    )


def fix_speed(model: FixModel) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, horizontal speeds and their sd of the fixes that have velocity."""
    has = (model.flags & HAS_VEL_H) > 0
    speed = np.hypot(model.values[has, 3], model.values[has, 4])
    return model.t[has], speed, np.sqrt(model.white_var[has, 3] + model.white_var[has, 4])


def as_shown(model: FixModel, options: FusionOptions, factors: Mapping[str, float]) -> FixModel:
    """Fixes whose errors have the sizes that a drive shows; ``factors`` by level, 1 for none."""
    levels = ("position_h", "position_h", "position_v", "velocity_h", "velocity_h", "velocity_v")
    white = np.array([factors.get(level, 1.0) for level in levels]) ** 2
    shown = lasting_share(options, factors) / lasting_share(options, {})
    return replace(model, white_var=model.white_var * white, stated_sd=model.stated_sd * shown)


def build_nodes(
    model: FixModel,
    shift: Shift,
    span: tuple[float, float],
    standstill: list[tuple[float, float]],
    speed_t: FloatArray,
    speed: FloatArray,
    lateral: FloatArray,
    odometer: Odometer | None,
    options: FusionOptions,
    constrained: bool,
) -> Nodes:
    """Merge fixes (shifted onto IMU stamps), standstill and filler instants.

    ``span`` the first and last instant of the trajectory in s; fixes outside it are left out.
    ``standstill`` intervals in s; ``speed`` and ``lateral`` acceleration at ``speed_t`` in
    m/s and m/s^2 decide where and how well the vehicle constraint holds (with ``constrained``).
    """
    model = _split(model, shift)
    wheels_t = np.zeros(0)
    if odometer is not None and constrained:
        wheels_t = shift.wheel_times(odometer.t)
    t, row, wheel_row = _node_times(model.t, wheels_t, span)

    n = len(t)
    flags = np.zeros(n, dtype=np.int64)
    values = np.zeros((n, N_VALUES))
    var = np.ones((n, MAX_SCALARS))
    lasting = np.ones((n, 6))
    has = row >= 0
    flags[has] = model.flags[row[has]]
    values[has, :6] = model.values[row[has]]
    var[has, CH_POS : CH_POS + 6] = model.white_var[row[has]]
    if has.any():
        latest = np.maximum.accumulate(np.where(has, np.arange(n), -1))
        latest = np.where(latest < 0, int(np.flatnonzero(has)[0]), latest)
        stated = model.stated_sd[row[latest]]
        quick = stated * model.larger[row[latest], 1:]
        lasting = np.concatenate([stated, quick], axis=1)
    before = np.concatenate([lasting[:1], lasting[:-1]])
    keep_share = np.minimum(before / lasting, lasting / before)

    spacing = np.diff(t, prepend=t[0] - limits.MAX_NODE_SPACING_S)
    spacing = np.clip(spacing, limits.LEAST_SPACING_S, limits.MOST_SPACING_S)
    still = np.zeros(n, dtype=bool)
    for start, stop in standstill:
        still |= (t >= start) & (t <= stop)
    note_rest(flags, var, still, spacing, options)
    if constrained and len(speed_t):
        at_nodes = np.interp(t, speed_t, speed), np.interp(t, speed_t, lateral)
        constrain(flags, var, *at_nodes, still, spacing, options)
    if odometer is not None and constrained:
        note_wheels(flags, values, var, wheel_row, odometer)
    fix_row = np.where(has, model.row[np.maximum(row, 0)] if len(model.row) else -1, -1)
    slow, quick = lasting[:, :3].copy(), lasting[:, 3:].copy()
    return Nodes(t, flags, values, var, slow, quick, fix_row.astype(np.int64), keep_share)


def _node_times(
    fix_t: FloatArray, wheels_t: FloatArray, span: tuple[float, float]
) -> tuple[FloatArray, IntArray, IntArray]:
    """Times of the nodes: of fixes, of wheel speeds, the ends of ``span``, and fillers between
    them; of each the fix and the wheel speed that it has, -1 for none."""
    of_fix = np.flatnonzero((fix_t >= span[0]) & (fix_t <= span[1]))
    of_wheels = np.flatnonzero((wheels_t >= span[0]) & (wheels_t <= span[1]))
    none = np.full(2, -1)
    t = np.concatenate([fix_t[of_fix], wheels_t[of_wheels], span])
    row = np.concatenate([of_fix, np.full(len(of_wheels), -1), none])
    wheel_row = np.concatenate([np.full(len(of_fix), -1), of_wheels, none])
    # of one instant those first that have something
    order = np.lexsort((-wheel_row, -row, t))
    t, row, wheel_row = t[order], row[order], wheel_row[order]
    keep = np.concatenate([[True], (np.diff(t) > 1e-6) | (row[1:] >= 0) | (wheel_row[1:] >= 0)])
    t, row, wheel_row = t[keep], row[keep], wheel_row[keep]
    pieces = np.ceil(np.diff(t) / limits.MAX_NODE_SPACING_S - 1e-9).astype(int)
    wide = np.flatnonzero(pieces > 1)
    place = np.repeat(wide + 1, pieces[wide] - 1)
    if len(wide):
        first = np.repeat(np.cumsum(pieces[wide] - 1) - pieces[wide] + 1, pieces[wide] - 1)
        step = (t[place] - t[place - 1]) / pieces[place - 1]
        t = np.insert(t, place, t[place - 1] + (np.arange(1, len(place) + 1) - first) * step)
        row, wheel_row = (np.insert(r, place, -1) for r in (row, wheel_row))
    return t, row.astype(np.int64), wheel_row.astype(np.int64)


def _split(model: FixModel, shift: Shift) -> FixModel:
    """Fixes on IMU stamps, velocities apart from positions where they belong to another time."""
    t, values = shift.position_times(model.t), model.values.copy()
    # metres a second of a clock that runs fast
    values[:, 3:6] /= 1.0 + shift.skew
    if shift.course_s != 0.0:
        values[:, 3:5] = told_later(model.t, values[:, 3:5], 0.0, shift.course_s)
    model = replace(model, t=t, values=values)
    if shift.velocity_delay_s == 0.0:
        return model
    position = (model.flags & (HAS_POS_H | HAS_POS_V)) > 0
    velocity = (model.flags & (HAS_VEL_H | HAS_VEL_V)) > 0
    rows = np.concatenate([np.flatnonzero(position), np.flatnonzero(velocity)])
    n_pos = int(position.sum())
    flags = model.flags[rows].copy()
    flags[:n_pos] &= HAS_POS_H | HAS_POS_V
    flags[n_pos:] &= HAS_VEL_H | HAS_VEL_V
    times = t[rows].copy()
    times[n_pos:] -= shift.velocity_delay_s
    order = np.argsort(times, kind="stable")
    rows = rows[order]
    return FixModel(
        times[order],
        flags[order],
        model.values[rows],
        model.white_var[rows],
        model.stated_sd[rows],
        model.row[rows],
        model.larger[rows],
    )
