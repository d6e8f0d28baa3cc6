"""What decides, over grids of what it decides on: a limit that moves moves where it decides."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tests.unit.scenarios import scenario
from tests.unit.scenarios_fusion import fixes_on, wavy_path


def _rows(first: float, last: float, n: int = 60) -> list[float]:
    return [float(x) for x in np.geomspace(first, last, n)]


@scenario
def decisions_sync() -> Any:
    """Units of speed, courses, lags, offsets, brakes, units of wheels."""
    from automap.sync import clock, held_values
    from automap.sync import velocity_findings as module
    from automap.sync.coarse import CoarseOffset
    from automap.sync.path_match import Estimate, Match
    from automap.sync.unit_mistakes import by_minutes, unit_mistake

    plain = module.VelocityConsistency(
        100.0, Match(), False, None, False, (), (), (), (), None, 1.0
    )

    def of(**changes: Any) -> Any:
        return replace(plain, match=replace(plain.match, **changes))

    scales = _rows(0.02, 200.0, 160)
    found: dict[str, Any] = {}
    for sd in (0.001, 0.01, 0.05, 0.3):
        units = [unit_mistake(Estimate(s, sd * s)) for s in scales]
        found[f"unit {sd}"] = [0.0 if u is None else u.factor for u, _ in units]
        found[f"wrong {sd}"] = [float(wrong) for _, wrong in units]
        minutes = [by_minutes(Estimate(s, sd)) for s in _rows(0.4, 2.5)]
        found[f"minutes {sd}"] = [float(len(text)) for text in minutes]
        turns = [of(turn_rad=Estimate(x, sd)) for x in _rows(0.01, 1.0)]
        found[f"course {sd}"] = [float(each.course_off) for each in turns]
        lags = [
            of(speed_lag_s=Estimate(-x, sd), course_lag_s=Estimate(-0.9 * x, 2.0 * sd))
            for x in _rows(0.05, 3.0)
        ]
        found[f"late {sd}"] = [each.positions_late_s for each in lags]
    t = np.array([0.0, 0.5, 1.0])
    found["brakes"] = [
        float(held_values._too_hard(t[:2] * step, np.array([0.0, v]) + 0j, 0))
        for v in _rows(1.0, 40.0)
        for step in (0.4, 1.0, 2.0)
    ]
    found["certain"] = [
        float(CoarseOffset(0.0, s, r).certain) for s in _rows(5.0, 90.0) for r in (0.0, 20.0)
    ]
    found["spans"] = [float(len(clock._utc(s))) for s in (-1e-9, 0.0, *_rows(1e9, 9e9))]
    return found


@scenario
def decisions_wheels() -> Any:
    """Units and contradictions of wheel speeds; counters that hang; steps of them."""
    from automap.fusion import wheel_match, wheels
    from automap.fusion.wheel_match import OTHER, UNITS

    names = {"": 0.0, OTHER: -1.0} | {name: 1.0 + k for k, name in enumerate(UNITS)}
    plain = wheel_match.WheelMatch(0.1, 0.1, 1.0, 0.01, 0.3, 5.0, 0.1, 100)
    found: dict[str, Any] = {
        "units": [names[replace(plain, scale=s).unit] for s in _rows(0.3, 900.0, 300)],
        "rest": [
            float(wheels.contradiction(replace(plain, rest=r, spread=s)) is None)
            for r in _rows(0.3, 30.0)
            for s in (0.5, 3.0, 20.0)
        ],
        "late": [
            float(wheels.contradiction(replace(plain, late_s=s, late_sd_s=sd)) is None)
            for s in _rows(1.0, 9.0)
            for sd in (0.1, 0.29, 0.31)
        ],
    }
    rng = np.random.default_rng(1)
    for k, step in enumerate(_rows(0.002, 0.6, 12)):
        speed = step * np.rint(rng.uniform(0.0, 15.0, 60) / step)
        for off in (0.0, 0.05, 0.09, 0.11):
            found[f"step {k} {off}"] = wheel_match.step_of(
                speed + off * step * rng.choice([-1, 1], 60)
            )
        found[f"few {k}"] = [wheel_match.step_of(step * np.arange(float(n))) for n in (7, 8, 9, 10)]
    t = np.arange(0.0, 60.0, 0.1)
    for hung in (1.5, 1.9, 2.1, 2.9, 3.1, 8.0):
        for change in (0.2, 0.9, 1.1, 1.9, 3.0):
            at = wheel_match.Reference(t[::5], 8.0 + change * np.sin(t[::5]), np.full(120, 0.05))
            speed = np.interp(t, at.t, at.speed)
            speed[(t > 20.0) & (t < 20.0 + hung)] = 8.1
            found[f"hung {hung} {change}"] = float(wheel_match.stuck(t, speed, at).sum())
            slow = wheel_match.Reference(t[::5], np.full(120, 1.3 + change), np.full(120, 0.05))
            speed[(t > 20.0) & (t < 20.0 + hung)] = 0.0
            found[f"still {hung} {change}"] = float(wheel_match.stuck(t, speed, slow).sum())
    signed = [wheels._directed(np.array([1.0, -x, 2.0, -x, 9.0])) for x in _rows(1.0, 20.0)]
    found["directed"] = [[s, told] for s, told in signed]
    return found


@scenario
def decisions_fusion() -> Any:
    """Estimates, delays, levels, leans, headings, accuracies and sigmas over their limits."""
    from automap.fusion import adapt, consistency
    from automap.fusion.doubts import estimates, outcome
    from automap.fusion.measurements.position import hold_reported_sd, states_accuracy
    from automap.fusion.nodes import Shift
    from automap.fusion.options import FusionOptions

    sizes = _rows(0.02, 3.0)
    found: dict[str, Any] = {}
    for name in (
        "imu_time_offset_s",
        "gnss_latency_s",
        "gnss_velocity_latency_s",
        "gnss_velocity_lag_tau",
    ):
        for sign in (1.0, -1.0):
            told = [estimates.impossible_ages({name: (sign * x, 0.01)}, True) for x in sizes]
            found[f"{name} {sign}"] = [float(len(each)) for each in told]
    found["skew"] = [
        float(len(estimates.impossible_ages({"imu_clock_skew_skew": (x, 1.0)}, True)))
        for x in _rows(5e-3, 2e-2)
    ]
    for sd in (0.01, 0.05, 0.2):
        told = [
            estimates.unexpected_delay({"imu_time_offset_s": (x, 0.01)}, 0.1, sd, 10.0)
            for x in sizes
        ]
        found[f"delay {sd}"] = [
            sum(r.error_m + r.late_s for r in each) + len(each) for each in told
        ]
    for effect in ("accel_scale", "gyro_scale", "accel_bias", "gyro_bias"):
        told = [estimates.impossible_errors({f"{effect}_y": (x, 0.1)}) for x in sizes]
        found[effect] = [float(len(each)) for each in told]
    for tuned in (False, True):
        told = [estimates.levels_at_bound({"gyro": x}, tuned) for x in _rows(5.0, 90.0)]
        found[f"levels {tuned}"] = [float(len(each)) for each in told]
    found["heading"] = [
        float(len(outcome.weak_heading(m, c)))
        for m in _rows(2.0, 9.0)
        for c in (0.2, 0.25, 0.27, 0.4)
    ]
    found["unsure"] = [float(len(outcome.unsure_path(x))) for x in _rows(5.0, 90.0)]
    path = wavy_path(700, 0.3, 2)
    for lean in _rows(0.02, 0.5, 24):
        tilted = replace(path, rpy=path.rpy * 0.1 + [lean, 0.0, 0.0])
        steep = replace(path, rpy=path.rpy * 0.1 + [0.0, lean, 0.0])
        sd = np.full(700, 0.01)
        found[f"lean {lean:.3f}"] = [
            float(len(outcome.leaning(tilted))),
            float(len(outcome.leaning(steep))),
            outcome.mounted_askew(tilted, sd)[1],
        ]
    for count in (19, 21, 400):
        channels = [
            consistency.ChannelConsistency(count, s, r, 1.0)
            for s in _rows(0.5, 4.0, 20)
            for r in (0.0, 0.4, 0.9)
        ]
        found[f"factor {count}"] = [c.sigma_factor for c in channels]
        found[f"doubts {count}"] = [
            float(len(consistency.innovation_doubts({"position_n": c}))) for c in channels
        ]
    fixes = fixes_on(path, 2, 5)
    for scale in _rows(0.1, 2.0, 12):
        told_sd = replace(fixes, sd_pos_ned=scale * fixes.sd_pos_ned)
        found[f"accuracy {scale:.3f}"] = states_accuracy(told_sd, FusionOptions())
    rng = np.random.default_rng(2)
    for jitter in (0.0, 0.02, 0.05, 0.08, 0.15, 0.4):
        for change in (1.1, 1.2, 1.3, 1.9, 2.2):
            sd = (
                np.exp(jitter * rng.normal(size=(40, 3)))
                * np.where(np.arange(40) > 21, change, 1.0)[:, None]
            )
            found[f"held {jitter} {change}"] = hold_reported_sd(sd)
    found["starts"] = [Shift(x).host_times(np.array([1.0])) for x in sizes[:3]]
    tops = {f"{e} {t}": (e, t) for e in (0.5, 2.0) for t in _rows(0.05, 20.0, 12)}
    for name, (weight, top) in tops.items():

        def score(trial: dict[str, float], w: float = weight, at: float = top) -> float:
            return -w * float(np.log(trial["accel"] / at) ** 2)

        one = {"accel": 1.0}
        best, factors = adapt._climb("accel", score(one), one, score, adapt.COARSE, (0.2, 16.0))
        found[f"climb {name}"] = [
            best,
            factors["accel"],
            adapt._refined("accel", factors["accel"], factors, score, adapt.COARSE),
        ]
    return found
