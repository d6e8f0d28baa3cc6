"""Kept figures of what the fusion doubts of sensors: offsets and estimates."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from automap.records import Fixes, ImuData
from tests.unit.scenarios import scenario
from tests.unit.scenarios_fusion import fixes_on, told, wavy_path, words_of


def _most() -> Any:
    from automap.fusion.doubts.limits import MOST_SENSOR_ERROR

    return MOST_SENSOR_ERROR


@scenario
def fusion_offsets() -> Any:
    """Positions aside of where velocities lead: in turn, from an instant on, throughout."""
    from automap.fusion.doubts import alternation, offsets
    from automap.fusion.fix_axes import smooth_epochs, usable_epochs, whitened_epochs
    from automap.fusion.gnss_only import as_sure_as_fixes, at_least, smooth_fixes, uncorrected
    from automap.fusion.options import FusionOptions
    from tests.unit.fusion_drive import CLOCK

    path = wavy_path(500, 0.2, 5, 0.2)
    sound = fixes_on(path, 2, 4)
    side = np.column_stack([np.cos(path.rpy[::2, 2]), np.sin(path.rpy[::2, 2])])
    right = np.column_stack([-side[:, 1], side[:, 0]])
    n = len(sound)

    def moved(metres: np.ndarray) -> Fixes:
        return replace(
            sound,
            lat_rad=sound.lat_rad + metres[:, 0] / 6.37e6,
            lon_rad=sound.lon_rad + metres[:, 1] / 4.44e6,
        )

    aside = 3.0 * side - 5.0 * right
    some = (np.arange(n) > 130)[:, None]
    still = replace(sound, vel_ned=np.full_like(sound.vel_ned, np.nan))
    logs = {
        "sound": sound,
        "beside": moved(aside),
        "later": moved(-aside * some),
        "in turn": moved(4.0 * right * (np.arange(n) % 2)[:, None]),
        "still": still,
        "short": Fixes(**{k: v[:12] for k, v in vars(sound).items()}),
    }
    levels = {"position_h": 1.2, "velocity_h": 0.8, "wander": 1.3, "multipath": 0.7}
    options = FusionOptions(velocity_wander_sd=0.3)
    found: dict[str, Any] = {}
    for name, log in logs.items():
        at = usable_epochs(log, options)
        alone = smooth_fixes(log, CLOCK, options, levels)
        found[name] = {
            "reasons": list(offsets.offset_doubts(at, alone, options, levels, 2.0)),
            "offsets": offsets.offsets(at, alone, options, levels),
            "turns": alternation.alternation(at, options, levels),
        }
        if name in ("sound", "still", "later"):
            out = np.zeros((len(at.t), 4))
            errors = np.stack([np.sin(at.z[0]), np.cos(at.z[1])], axis=2)
            found[name] |= {
                "epochs": at,
                "alone": alone,
                "score": [smooth_epochs(at, axis, options, levels, out) for axis in range(3)],
                "white": [whitened_epochs(at, axis, options, levels, errors) for axis in range(3)],
                "as_sure_as_fixes": as_sure_as_fixes(alone, log, options, levels),
                "uncorrected": uncorrected(alone, log, options),
                "at least": at_least(alone, path.gps_s[::50], 2.0 + np.sin(path.vel_ned[::50])),
                "instants": offsets._instants(at, at.used[0, :, 0]),
            }
    calm = fixes_on(path, 2, 4, vel_ned=path.vel_ned[::2] + 0.02, sd_pos_ned=np.full((n, 3), 1.1))
    noise = np.random.default_rng(6).normal(0.0, 0.2, (n, 2))
    for size in (0.0, 0.5, 2.0, 6.0):
        turns = size * right * (np.arange(n) % 2)[:, None] + noise
        turns[40:44] += 9.0
        log = replace(
            calm,
            lat_rad=path.lat_rad[::2] + turns[:, 0] / 6.37e6,
            lon_rad=path.lon_rad[::2] + turns[:, 1] / 4.44e6,
        )
        at = usable_epochs(log, options)
        quiet = smooth_fixes(log, CLOCK, options, levels)
        found[f"turns {size}"] = [
            alternation.alternation(at, options, levels),
            list(offsets.offset_doubts(at, quiet, options, levels, 2.0)),
        ]
        # in the order of their measurements, from the first to the last
        found[f"after {size}"] = offsets.offsets(at, quiet, options, levels)
    words = [offsets.Offset(a, b, 1.0) for a, b in ((3.0, 0.2), (-2.0, 2.5), (0.3, -4.0))]
    found["words"] = [f"{offsets._words(w)} {w.size:.9g}" for w in words]
    rows, beside = (
        np.random.default_rng(1).normal(size=(40, 3)),
        np.random.default_rng(2).normal(size=(40, 2)),
    )
    rows[:, 0] += 2.0 * rows[:, 1] - 3.0 * rows[:, 2]
    rows[5, 0] += 30.0
    hole = rows.copy()
    hole[3, 0] = np.nan
    lost = beside.copy()
    lost[3, 0] = np.inf
    found["fitted"] = [
        offsets._fitted(a[:, 0], a[:, 1:], b)
        for a, b in ((rows, beside), (9.0 * rows, beside), (hole, beside), (rows, lost))
    ]
    none = replace(sound, fix_type=0 * sound.fix_type)
    found["none"] = [
        told(usable_epochs, none, options),
        told(as_sure_as_fixes, alone, none, options),
    ]
    return found


@scenario
def fusion_estimate_doubts() -> Any:
    """Estimates just within and just beyond what can be; gyro against accelerometer; readings."""
    from automap.fusion.doubts import antenna, estimates, readings, triads
    from automap.fusion.unusable_readings import bridge_unusable

    rng = np.random.default_rng(5)
    ages = {
        "fine": {"gnss_velocity_latency_s": (-0.1, 0.01), "imu_time_offset_s": (0.1, 0.01)},
        "ahead": {"gnss_velocity_latency_s": (-0.2, 0.005), "gnss_velocity_lag_tau": (0.01, 0.004)},
        "both": {"gnss_velocity_latency_s": (-0.4, 0.03), "imu_time_offset_s": (0.3, 0.01)},
        "bounds": {
            "imu_time_offset_s": (0.985, 0.01),
            "gnss_latency_s": (-0.995, 0.01),
            "gnss_velocity_latency_s": (0.995, 0.1),
            "gnss_velocity_lag_tau": (0.995, 0.1),
            "imu_clock_skew_skew": (0.00992, 0.1),
        },
    }
    found: dict[str, Any] = {
        name: [words_of(estimates.impossible_ages(each, by)) for by in (False, True)]
        for name, each in ages.items()
    }
    found["delay"] = [
        words_of(
            estimates.unexpected_delay({"imu_time_offset_s": (0.1 + off, 0.01)}, 0.1, 0.05, 11.0)
        )
        for off in (0.09, -0.11, 0.23, -0.26)
    ] + [words_of(estimates.unexpected_delay({}, 0.1, 0.05, 11.0))]
    for size in (0.9, 1.1):
        large = {
            f"{effect}_{axis}": (size * (most if axis == "y" else -0.5 * most), 0.1)
            for effect, (most, _, _) in _most().items()
            for axis in "xyz"
        }
        found[f"errors {size}"] = words_of(estimates.impossible_errors(large))
    stated = np.array([0.5, -0.4, -1.0])
    for lag in (0.0, -0.2):
        for sd in (0.03, 0.001, 0.0499):
            for off in (0.6, 1.4):
                arm = {
                    f"gnss_lever_arm_{a}": (v + off * s, sd)
                    for a, v, s in zip("xyz", stated, (0.5, -1, 2), strict=True)
                }
                arm |= {
                    "gnss_velocity_latency_s": (lag, 0.1),
                    "gnss_velocity_lag_tau": (-0.05, 0.1),
                }
                found[f"arm {lag} {sd} {off}"] = [
                    antenna.arm_by_drive(arm, stated, 0.05, 3.0),
                    words_of(antenna.contradicted_arm(arm, stated, 0.05, 3.0)),
                ]
    found["no arm"] = [
        antenna.arm_by_drive(arm, None, 0.05, 3.0),
        antenna.contradicted_arm(arm, None, 0.05, 3.0),
        antenna.arm_by_drive({}, stated, 0.05, 3.0),
    ]
    levels = {
        "accel": 15.9,
        "gyro": 15.7,
        "position_h": 64.0,
        "position_v": 63.0,
        "velocity_h": 2.0,
    }
    found["levels"] = [
        words_of(estimates.levels_at_bound(levels, tuned)) for tuned in (False, True)
    ]
    n = 1600
    t = 0.05 * np.arange(n)
    speed = 8.0 + 4.0 * np.sin(0.07 * t)
    turn = 0.3 * np.sin(0.5 * t) * np.cos(0.13 * t)
    axes = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for late in (0.0, 0.4, -0.45):
        force = np.interp(t - late, t, speed * turn) + rng.normal(0.0, 0.3, n) + 0.2
        gyro = np.column_stack([0.01 * rng.normal(size=(n, 2)), turn + 0.01 * rng.normal(size=n)])
        accel = np.column_stack([rng.normal(0.0, 0.3, n), force, rng.normal(-9.8, 0.3, n)])
        stamps = np.int64(7 * 10**9) + np.rint(t * 1e9).astype(np.int64)
        imu = ImuData(stamps, gyro @ axes, accel @ axes)
        gap = ImuData(
            *(np.delete(a, np.s_[500:540], axis=0) for a in (imu.t_ns, imu.gyro, imu.accel))
        )
        found[f"late {late}"] = [
            triads.lateness(imu, axes, speed),
            triads.lateness(gap, axes, np.delete(speed, np.s_[500:540])),
            words_of(triads.triad_doubts(imu, axes, speed)),
        ]
    found["no bends"] = [
        triads.lateness(imu, axes, v)
        for v in (0.1 * speed, speed * (t < 0.8), rng.uniform(4.0, 9.0, n) ** 3)
    ]
    short = ImuData(imu.t_ns[:15], imu.gyro[:15], imu.accel[:15])
    found["short"] = [
        triads.lateness(short, axes, speed[:15]),
        readings.reading_doubts(short, bridge_unusable(short), speed[:15]),
    ]
    hung = [a.copy() for a in (imu.gyro, imu.accel)]
    for a in hung:
        a[300:360] = a[300]
    one = [a.copy() for a in (imu.gyro, imu.accel)]
    one[0][700:900, 1] = 0.5
    clipped = [np.clip(3.0 * a, -9.0, 9.0) for a in (imu.gyro, imu.accel)]
    wild = [a.copy() for a in (imu.gyro, imu.accel)]
    wild[0][[200, 203, 900], 2] = 40.0
    for name, (gyro, accel) in {"hung": hung, "one": one, "clipped": clipped, "wild": wild}.items():
        log = ImuData(imu.t_ns, gyro, accel)
        bridged = bridge_unusable(log)
        found[name] = [
            words_of(readings.reading_doubts(log, bridged, v))
            for v in (speed, np.where(t < 30.0, 0.0, speed))
        ]
        found[f"{name} bridged"] = bridged
    return found
