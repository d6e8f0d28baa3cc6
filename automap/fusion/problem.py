"""One filter problem as arrays, and the calls into the kernels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import IO, NamedTuple

import numpy as np

from automap.effects import Signals, extra_basis
from automap.effects.term_sums import (
    AXIS,
    COURSE,
    POINT,
    SIGNAL_COLUMN,
    SIGNAL_ELAPSED,
    SIGNAL_ONE,
    TIME,
    Terms,
)
from automap.effects.terms import POSITION_ACCURACY
from automap.effects.user import is_users, user_signal
from automap.fusion.aside import Columns, columns_in
from automap.fusion.kernels import ModelArrays, Samples
from automap.fusion.layout import N_NAV
from automap.fusion.limits import MAX_INFLATION, REFUSED_INFLATION
from automap.fusion.model import StateModel
from automap.fusion.nodes import Nodes
from automap.fusion.options import FusionOptions
from automap.fusion.shocks import shock_noise
from automap.fusion.steady_readings import steady
from automap.fusion.unusable_readings import gap_noise
from automap.gates import gate
from automap.records import BoolArray, FloatArray, ImuData, IntArray


@dataclass(frozen=True)
class Problem:
    """Readings and model in the form the kernels take; ``arrays`` are the model's, ``users`` the
    users' signals [n] at the samples that its terms on fixes and vehicle are multiplied with,
    ``turning`` [n] rad/s the vehicle's rate of turn. Where a long drive's samples are ``stored``,
    ``samples`` has their times alone."""

    samples: Samples
    model: StateModel
    options: FusionOptions
    arrays: ModelArrays
    users: Mapping[str, FloatArray] = field(default_factory=dict)
    turning: FloatArray = field(default_factory=lambda: np.zeros(0))
    stored: Columns | None = None

    @property
    def t(self) -> FloatArray:
        """Sample times [n] in s from the first."""
        return self.samples.t

    def samples_at(self, rows: slice) -> Samples:
        """Some of the samples."""
        if self.stored is None:
            return Samples(*(values[rows] for values in self.samples))
        others = (self.stored.read(name, rows) for name in Samples._fields[1:])
        return Samples(self.t[rows], *others)

    def samples_between(self, begin: float, end: float) -> Samples:
        """Those that a kernel takes between nodes at two instants: one before the first, and two
        after the last."""
        first = max(int(np.searchsorted(self.t, begin, "right")) - 2, 0)
        stop = int(np.searchsorted(self.t, end, "left")) + 3
        return self.samples_at(slice(first, min(stop, len(self.t))))


def stored(problem: Problem, file: IO[bytes]) -> Problem:
    """The problem with its samples in ``file``, which stays open while they are asked for."""
    names = Samples._fields[1:]
    widths = {name: getattr(problem.samples, name).shape[1] for name in names}
    columns = columns_in(file, len(problem.t), widths)
    for name in names:
        columns.write(name, 0, getattr(problem.samples, name))
    samples = Samples(problem.t, *(getattr(problem.samples, name)[:0].copy() for name in names))
    return replace(problem, samples=samples, stored=columns)


def make_problem(
    imu: ImuData,
    model: StateModel,
    options: FusionOptions,
    speed: FloatArray | None = None,
    signals: Signals | None = None,
    made_noise: FloatArray | None = None,
    readings: Samples | None = None,
) -> Problem:
    """Problem of a recording; ``speed`` [n] m/s feeds effects that grow with it, ``signals`` [n]
    those that follow from the drive; ``made_noise`` [n, 2] the PSD of what made-up force and rate
    err by; ``readings`` of ``samples_of``, where these are known already."""
    terms = list(model.terms)
    extra = extra_basis(terms, imu.gyro, imu.accel, imu.temp_c, speed, signals=signals)
    readings = readings or samples_of(imu, options, made_noise)
    samples = readings._replace(extra=np.ascontiguousarray(extra))
    step = float(np.median(np.diff(samples.t)))
    users = {}
    if signals is not None:
        users = {n: user_signal(n, signals) for n in model.signals if is_users(n)}
    return Problem(samples, model, options, _model_arrays(model, options, step), users)


def samples_of(
    imu: ImuData, options: FusionOptions, made_noise: FloatArray | None = None
) -> Samples:
    """A recording as the filter reads it, whatever the model: without extra signals."""
    t = np.asarray((imu.t_ns - imu.t_ns[0]) * 1e-9)
    step = float(np.median(np.diff(t)))
    raw = _for_linear_steps(imu, t, step)
    gaps = (options.gap_factor * step, options.gap_force_sd, options.gap_rate_sd)
    shocks = gap_noise(t, imu.gyro, imu.accel, *gaps)
    if options.shocks:
        shocks += shock_noise(imu.gyro, imu.accel, step)
    if made_noise is not None:
        shocks = shocks + made_noise
    calm = np.empty_like(raw)
    # of ten hours a column takes 30 MB: one at a time
    for k, values in enumerate((*imu.gyro.T, *imu.accel.T)):
        calm[:, k] = steady(t, values[:, None])[:, 0]
    calm -= raw
    return Samples(t, raw, np.zeros((len(t), 0)), calm, shocks)


def with_options(problem: Problem, options: FusionOptions | None = None) -> Problem:
    """The problem with other noise figures (same effects)."""
    options = options or problem.options
    step = float(np.median(np.diff(problem.t)))
    return replace(problem, options=options, arrays=_model_arrays(problem.model, options, step))


class LateChange(NamedTuple):
    """By how much more than at their tag late velocities change, at the samples [n, 3] NED: the
    ``whole`` of them as they grow later, m/s^2, what turns them as their ``course`` does, and as
    that is of a place further ``behind``, 1/s; ``swung`` by each metre of an antenna forward, right
    and down, 1/s, where nobody knows it."""

    whole: FloatArray
    course: FloatArray
    behind: FloatArray
    swung: tuple[FloatArray, ...] = ()


def with_late_change(problem: Problem, change: LateChange) -> Problem:
    """The problem in which velocities that are late change by what happened at the instant that
    they, and their courses, are of; those of a low-pass by what it lets through."""
    model, users = problem.model, dict(problem.users)
    codes, weights = model.measured.velocity
    every, signals = Terms(codes, weights), list(model.signals)
    # of a clock that runs fast the delay grows with the time
    growing = change.whole * problem.t[:, None]
    distance = codes[:, 0] == model.places.get("gnss_course_distance", 0) - N_NAV
    for late, name, amounts in (
        (_of_kind(codes, TIME, SIGNAL_ONE), "late_change", change.whole),
        (_of_kind(codes, TIME, SIGNAL_ELAPSED), "late_growth", growing),
        (_of_kind(codes, COURSE, SIGNAL_ONE), "late_course", change.course),
        (_of_kind(codes, POINT, SIGNAL_ONE) & distance, "late_distance", change.behind),
        *(
            (_of_kind(codes, POINT, signal) & ~distance & (codes[:, 2] == axis), name, along)
            for axis, swung in enumerate(change.swung)
            for signal, name, along in _along_signals(problem, swung, f"late_arm_{axis}")
        ),
    ):
        if not late.any():
            continue
        more = np.repeat(codes[late], 3, axis=0)
        more[:, 1] = AXIS
        more[:, 2] = np.tile(np.arange(3), int(late.sum()))
        more[:, 3] = SIGNAL_COLUMN + len(signals) + more[:, 2]
        every = Terms(
            np.concatenate([every.codes, more]),
            np.concatenate([every.weights, np.repeat(weights[late], 3)]),
        )
        names = [f"{name}_{axis}" for axis in "ned"]
        signals += names
        users |= dict(zip(names, np.ascontiguousarray(amounts.T), strict=True))
    terms = every
    measured = model.measured._replace(velocity=terms)
    model = replace(model, measured=measured, signals=tuple(signals))
    arrays = problem.arrays._replace(on_velocity=terms)
    return replace(problem, model=model, arrays=arrays, users=users)


def _along_signals(
    problem: Problem, amounts: FloatArray, name: str
) -> Iterator[tuple[int, str, FloatArray]]:
    """Amounts [n, 3] as they are, and times each signal of the users: code of the signal, a name,
    and amounts."""
    yield SIGNAL_ONE, name, amounts
    for column, signal in enumerate(problem.model.signals):
        if signal in problem.users:
            times = problem.users[signal][:, None]
            yield SIGNAL_COLUMN + column, f"{name} {signal}", amounts * times


def _of_kind(codes: IntArray, kind: int, signal: int) -> BoolArray:
    return np.asarray((codes[:, 1] == kind) & (codes[:, 3] == signal))


def _for_linear_steps(imu: ImuData, t: FloatArray, step: float) -> FloatArray:
    """Readings [n, 6] whose linear interpolation integrates like the cubic through the samples.

    Minus a twelfth of the second difference: then the trapezoid over a step equals the
    integral of the cubic interpolant. Next to gaps the samples stay as they are.
    """
    out = np.concatenate([imu.gyro, imu.accel], axis=1)
    spacing = np.diff(t)
    regular = (spacing[1:] < 1.5 * step) & (spacing[:-1] < 1.5 * step)
    # one column after another: of a long drive their differences are as large as its readings
    for k, column in enumerate((*imu.gyro.T, *imu.accel.T)):
        second = column[2:] - 2.0 * column[1:-1] + column[:-2]
        out[1:-1, k] -= np.where(regular, second / 12.0, 0.0)
    return out


def _model_arrays(model: StateModel, options: FusionOptions, step: float) -> ModelArrays:
    thresholds = [gate(options.gate_probability, rows) for rows in (1, 2, 3)]
    return ModelArrays(
        terms=model.term_table,
        on_position=model.measured.position,
        on_velocity=model.measured.velocity,
        on_vehicle=model.measured.vehicle,
        tau=model.tau,
        walk=model.walk,
        kept=model.kept,
        noise=np.array([options.accel_noise**2, options.gyro_noise**2]),
        longest_step=options.gap_factor * step,
        gate=np.array([*thresholds, MAX_INFLATION, REFUSED_INFLATION]),
        earth_on=bool(options.earth_rotation),
    )


def node_signals(problem: Problem, nodes: Nodes) -> FloatArray:
    """The signals [k, e] at the nodes that the model's terms on measurements are multiplied with:
    the sizes of the fixes' lasting errors, or a user's."""
    out = np.empty((len(nodes.t), len(problem.model.signals)))
    for column, name in enumerate(problem.model.signals):
        if name in problem.users:
            out[:, column] = np.interp(nodes.t, problem.t, problem.users[name])
        else:
            part, axis = divmod(POSITION_ACCURACY.index(name), 3)
            out[:, column] = (nodes.stated_sd, nodes.quick_sd)[part][:, axis]
    return out
