"""Wheel speed of a drive made ready for the filter: what is left out, how sure the rest is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.earth import local_ned
from automap.fusion import wheel_limits
from automap.fusion.kernels.axis import smooth_axis
from automap.fusion.layout import HAS_POS_H, HAS_VEL_H
from automap.fusion.limits import (
    LEAST_JUDGED,
    LEAST_SPACING_S,
    MOST_SPACING_S,
    OUTLIER_PROBABILITY,
    ROAD_ACCELERATION_PSD,
)
from automap.fusion.measurements.wheel_speed import Odometer
from automap.fusion.nodes import FixModel
from automap.fusion.options import FusionOptions
from automap.fusion.wheel_match import (
    OTHER,
    Reference,
    WheelMatch,
    match_wheels,
    runs,
    step_of,
    stuck,
)
from automap.gates import gate
from automap.records import FloatArray, IntArray, WheelSpeed


@dataclass(frozen=True)
class Wheels:
    """Wheel speed as the fusion takes it.

    ``odometer`` None where nothing of it is used, ``rate_hz`` of its samples, ``count`` how many
    of them, ``stuck`` how many of a counter that hung, ``step`` m/s; ``match`` against the
    receiver's speed, None where they cannot be compared; ``warnings`` a sentence each.
    """

    odometer: Odometer | None
    rate_hz: float
    count: int
    stuck: int
    step: float
    match: WheelMatch | None
    warnings: tuple[str, ...] = ()


def prepare_wheels(
    wheels: WheelSpeed | None,
    base_ns: int,
    span: tuple[float, float],
    fixes: FixModel,
    options: FusionOptions,
) -> Wheels | None:
    """Compare wheel speeds with the fixes' and turn them into readings.

    Stamps count from ``base_ns``, on the axis of the fixes' times and of ``span``, the first and
    last instant of the drive in s.
    """
    if wheels is None or len(wheels) < 2:
        return None
    t, speed = np.asarray((wheels.t_ns - base_ns) * 1e-9), wheels.speed
    return judge_wheels(t, speed, path_speed(fixes), options, span)


def judge_wheels(
    t: FloatArray,
    speed: FloatArray,
    reference: Reference,
    options: FusionOptions,
    span: tuple[float, float] | None = None,
) -> Wheels:
    """What wheel speeds [n] at ``t`` [n] s are worth against the receiver's; ``span`` first and
    last instant of the drive, s (None: those of the receiver's)."""
    step = step_of(speed)
    period = float(np.median(np.diff(t)))
    rate = 1.0 / period if period > 0.0 else np.inf
    if span is None and len(reference.t):
        span = float(reference.t[0]), float(reference.t[-1])
    elsewhere = _elsewhere(t, rate, span)
    if elsewhere:
        return Wheels(None, rate, len(t), 0, step, None, (elsewhere,))
    hung = stuck(t, speed, reference)
    count, lost = len(t), int(hung.sum())
    warnings = []
    if lost:
        begin = t[np.flatnonzero(hung)[0]]
        warnings.append(
            f"{lost} of {count} wheel speeds are stuck while the vehicle drives, first {begin:.0f} "
            "s into the drive; they are left out"
        )
    good_t, good = t[~hung], speed[~hung]
    match = None
    if len(good) > 1:
        match = match_wheels(good_t, good, reference, wheel_limits.LOOK_WHEELS_S)
    wrong = None if match is None else contradiction(match)
    if wrong is not None:
        warnings.append(f"{wrong[0]}; it is left out: {wrong[1]}")
    if len(good) < 2 or wrong is not None:
        return Wheels(None, rate, count, lost, step, match, tuple(warnings))
    late = noise = 0.0
    if match is not None:
        noise = match.noise
        late = match.late_s if match.late_sd_s < wheel_limits.SURE_WHEELS_S else 0.0
    odometer = readings(good_t, good, step, noise, late, options)
    return Wheels(odometer, rate, count, lost, step, match, tuple(warnings))


def _elsewhere(t: FloatArray, rate_hz: float, span: tuple[float, float] | None) -> str:
    """A sentence where the stamps ``t`` [n] s are of another clock or unit than is said; ``span``
    first and last instant of the drive, s (None unknown)."""
    what, reach = "", wheel_limits.LOOK_WHEELS_S
    if rate_hz > wheel_limits.FASTEST_WHEELS_HZ:
        most = f"{wheel_limits.FASTEST_WHEELS_HZ:.0f}"
        what = f"wheel speed comes more than {most} times a second, faster than a bus carries it"
    elif span is not None and not ((t >= span[0] - reach) & (t <= span[1] + reach)).any():
        after = float(t[0]) - span[0]
        side = "after" if after > 0.0 else "before"
        what = f"no wheel speed is of the drive: the first is {abs(after):.0f} s {side} it begins"
    if not what:
        return ""
    return (
        f"{what}; it is left out: is t_ns in nanoseconds, by the clock that time in [odometer] "
        "names, or else by that of the IMU?"
    )


def contradiction(match: WheelMatch) -> tuple[str, str] | None:
    """What a comparison says against the wheels, and what to do; None for nothing."""
    if match.rest > max(wheel_limits.WHEELS_APART, wheel_limits.WHEELS_UNLIKE * match.spread):
        text = f"wheel speed is {match.rest:.1f} m/s off and does not follow the receiver's"
        return text, "is it of this drive, and t_ns of the clock that stamps the IMU?"
    if match.unit:
        what = "which is no unit that is known" if match.unit == OTHER else f"as in {match.unit}"
        text = f"wheel speed is {match.scale:.3g} times the receiver's speed, {what}"
        return text, "write speed_m_s in metres per second"
    if (
        match.late_sd_s < wheel_limits.SURE_WHEELS_S
        and abs(match.late_s) > wheel_limits.MAX_WHEELS_S
    ):
        side = "later" if match.late_s > 0.0 else "earlier"
        text = f"wheel speed is {abs(match.late_s):.1f} s {side} than the receiver's"
        return text, "stamp t_ns by the clock that stamps the IMU, when the message comes in"
    return None


def readings(
    t: FloatArray,
    speed: FloatArray,
    step: float,
    noise: float,
    late_s: float,
    options: FusionOptions,
) -> Odometer:
    """Samples [n] as readings at their own times, never more often than wheels tell anything new.

    A reading is one sample, or the mean of those close around it. Its errors: the wheels' own and
    their slip over a second, the jitter of stamps, and the step of the counter, uniform
    (step^2 / 12, B. Widrow, IRE Transactions on Circuit Theory 3, 1956), which all samples of one
    value share.
    """
    speed, signed = _directed(speed)
    period = np.diff(t, prepend=t[0] - wheel_limits.WHEELS_SPACING_S)
    chosen = _spaced(t)
    half = 0.5 * wheel_limits.WHEELS_MEAN_S
    total = np.concatenate([[0.0], np.cumsum(speed)])
    when = np.concatenate([[0.0], np.cumsum(t - t[0])])
    # rounding of stamps shall not decide whether a sample belongs to the mean
    low = np.searchsorted(t, t[chosen] - half - wheel_limits.WHEELS_JITTER_S * half)
    high = np.searchsorted(t, t[chosen] + half + wheel_limits.WHEELS_JITTER_S * half)
    many = high - low
    mean, at = (total[high] - total[low]) / many, t[0] + (when[high] - when[low]) / many
    # of samples that came in a burst one mean is enough
    apart = np.diff(at, prepend=-np.inf) > half
    chosen, mean, at = chosen[apart], mean[apart], at[apart]
    spacing = np.diff(at, prepend=at[0] - max(float(period[0]), wheel_limits.WHEELS_SPACING_S))
    spacing = np.clip(spacing, LEAST_SPACING_S, MOST_SPACING_S)
    slope = np.gradient(mean, at) if len(at) > 1 else np.zeros(1)
    var = (options.odometer_sd**2 + noise**2 + (wheel_limits.WHEELS_SLIP * mean) ** 2) / spacing
    var += (wheel_limits.WHEELS_JITTER_S * slope) ** 2
    if step > 0.0:
        first, last = runs(speed)
        run = np.searchsorted(last, chosen)
        shared = np.bincount(run, minlength=len(first))[run]
        var += step**2 / 12.0 * shared
    size = np.abs(mean)
    slow = size < wheel_limits.SLOW_WHEELS
    var[slow] += np.maximum(wheel_limits.WHEELS_DEADBAND, 0.0 if signed else size[slow]) ** 2
    return Odometer(at, mean, var, late_s, signed)


def _directed(speed: FloatArray) -> tuple[FloatArray, bool]:
    """Speeds [n], forward positive, and whether their sign tells the direction: in some logs it
    counts the other way, and what is fast both ways has a sign that means something else."""
    if int((speed < -wheel_limits.FASTEST_REVERSE).sum()) > int(
        (speed > wheel_limits.FASTEST_REVERSE).sum()
    ):
        speed = -speed
    if (speed < -wheel_limits.FASTEST_REVERSE).any():
        return np.abs(speed), False
    return speed, bool((speed < 0.0).any())


def _spaced(t: FloatArray) -> IntArray:
    """Places of samples no nearer to each other than readings are."""
    least = wheel_limits.WHEELS_SPACING_S
    cell = np.floor((t - t[0]) / least + 0.5).astype(np.int64)
    off = np.abs(t - t[0] - cell * least)
    order = np.lexsort((off, cell))
    best = np.concatenate([[True], np.diff(cell[order]) > 0])
    return np.sort(order[best])


def path_speed(fixes: FixModel) -> Reference:
    """The speed that the fixes show: as their velocities tell it, or smoothed out of positions."""
    has = (fixes.flags & HAS_VEL_H) > 0
    if int(has.sum()) >= LEAST_JUDGED:
        speed = np.hypot(fixes.values[has, 3], fixes.values[has, 4])
        return Reference(fixes.t[has], speed, np.sqrt(fixes.white_var[has, 3:5].mean(axis=1)))
    use = np.flatnonzero((fixes.flags & HAS_POS_H) > 0)
    use = use[np.concatenate([[True], np.diff(fixes.t[use]) > 0.0])] if len(use) else use
    if len(use) < LEAST_JUDGED:
        return Reference(np.zeros(0), np.zeros(0), np.zeros(0))
    place = fixes.values[use]
    origin = (float(place[0, 0]), float(place[0, 1]), float(place[0, 2]))
    ned = local_ned(place[:, 0], place[:, 1], np.full(len(use), origin[2]), origin)
    axes = np.zeros((2, len(use), 4))
    nothing = np.zeros(len(use))
    for axis in range(2):
        smooth_axis(
            fixes.t[use],
            np.column_stack([ned[:, axis], nothing]),
            np.column_stack([nothing == 0.0, nothing > 0.0]),
            np.column_stack([fixes.white_var[use, axis], nothing + 1.0]),
            np.zeros((len(use), 2)),
            ROAD_ACCELERATION_PSD[axis],
            (1.0, 1.0),
            gate(OUTLIER_PROBABILITY, 1),
            axes[axis],
        )
    speed, sd = np.hypot(*axes[:, :, 1]), np.sqrt((axes[:, :, 3] ** 2).mean(axis=0))
    return Reference(fixes.t[use], speed, sd)
