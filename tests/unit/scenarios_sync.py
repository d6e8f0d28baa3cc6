"""Parts of the synchronisation: which clock, offsets of all sizes, what a receiver's log says."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from automap.records import NO_TIME, ClockModel, Fixes
from tests.unit import receiver_damage as damage
from tests.unit.receiver_scene import Receiver, simulated_fixes
from tests.unit.scenarios import scenario
from tests.unit.scenarios_fusion import fixes_on, told, wavy_path
from tests.unit.sync_scene import GPS_START, drive, fixes_of, imu_of


@scenario
def sync_clock() -> Any:
    """Every way to a clock, and clocks that the motions contradict."""
    from automap.sync import clock
    from automap.sync.coarse import CoarseOffset
    from automap.sync.correlation import Lag

    t, gyro, accel, motion = drive(90.0, 25.0)
    fixes = fixes_of(t, motion, rate=2.0)
    rng = np.random.default_rng(1)
    gps_ns = np.int64(round(GPS_START)) * np.int64(10**9)
    unix_ns = gps_ns + np.int64(315_964_800 - 18 + 2) * np.int64(10**9)
    arrival = np.rint((fixes.gps_s - GPS_START + 7.0 + rng.exponential(0.01, len(fixes))) * 1e9)
    heard = replace(fixes, arrival_ns=arrival.astype(np.int64))
    silent = replace(fixes, gps_s=np.full(len(fixes), np.nan))
    boot, of_gps, of_unix = (imu_of(t, gyro, accel, int(s)) for s in (7 * 10**9, gps_ns, unix_ns))
    early, leap, far = (
        imu_of(t, gyro, accel, int(gps_ns + s * 10**9)) for s in (5.0, 18.0, 86_400.0)
    )
    none = imu_of(t[:0], gyro[:0], accel[:0], 0)
    runs: dict[str, tuple[Any, ...]] = {
        "arrival": (boot, heard),
        "delay": (boot, heard, "boot_ns", "boot_ns", 0.05, 1e-4),
        "motion": (boot, fixes),
        "other": (boot, heard, "boot_ns", "gps_ns"),
        "gps": (of_gps, fixes, "gps_ns"),
        "unix": (of_unix, fixes, "unix_ns"),
        "early": (early, fixes, "gps_ns"),
        "leap": (leap, fixes, "gps_ns"),
        "far": (far, fixes, "gps_ns"),
        "as unix": (of_unix, fixes, "gps_ns"),
        "as gps": (of_gps, fixes, "unix_ns"),
        "no fixes": (boot, None),
        "silent": (boot, silent),
        "silent unix": (of_unix, silent, "unix_ns"),
        "no imu": (None, heard),
        "empty imu": (none, heard, "boot_ns", "gps_ns"),
        "alone": (None, fixes),
        "nothing": (None, None),
        "nothing dated": (None, silent),
    }
    found: dict[str, Any] = {
        name: told(clock.synchronise, *values) for name, values in runs.items()
    }
    found["rough"] = [
        told(clock.rough_clock, *values)
        for values in ((boot, heard), (boot, fixes), (of_gps, fixes, "gps_ns"), (boot, silent))
    ]
    stated = ClockModel(0, GPS_START, 0.0, 1e-3, 1e-9, "identity", 0.0)
    refused = []
    for offset in (18.2, 17.5, -18.9, 5.1, 5.29, 5.31, -3.5):
        for better in (9.0, 11.0, 39.0, 41.0):
            for near in (None, CoarseOffset(0.0, 2.0, 0.0)):
                warnings: list[str] = []
                score = better + (0.0 if near is None else 2.0)
                seen = CoarseOffset(offset, score, 1.0)
                refused.append(
                    str(told(clock._refuse, stated, seen, near, warnings)) + str(warnings)
                )
    found["refused"] = refused
    lags = {
        n: Lag(0.1 if n == "velocity" else 0.2, sd, 9.0, 30)
        for n, sd in (("velocity", 0.04), ("position", 0.055))
    }
    for position, velocity in ((0.055, 0.04), (0.07, 0.04), (0.049, 0.001), (0.051, 0.001)):
        lags = {
            "position": replace(lags["position"], sd_s=position),
            "velocity": replace(lags["velocity"], sd_s=velocity),
        }
        found[f"lag {position} {velocity}"] = [
            clock._best_lag(lags),
            clock._best_lag({"position": lags["position"]}),
            clock._best_lag({"velocity": lags["velocity"]}),
            clock._best_lag({}),
        ]
    found["words"] = [clock._utc(s) for s in (-1.0, 0.0, 1.4e9, 3.9e9, 4.1e9, np.inf)]
    found["certain"] = [
        str(CoarseOffset(0.0, score, other).certain)
        for score, other in ((24.0, 0.0), (26.0, 0.0), (26.0, 11.0), (26.0, 13.0))
    ]
    found["unknown"] = clock.unknown_clock(np.array([5, 9]) * 10**9)
    found["empty"] = [
        clock.gps_clock(np.zeros(0, np.int64)),
        clock.unix_clock(np.zeros(0, np.int64)),
    ]
    return found


@scenario
def sync_offsets() -> Any:
    """Offsets between motions with holes, and the parts by which they are found."""
    from automap.sync import coarse, correlation
    from automap.sync.motion import (
        GnssMotion,
        ImuMotion,
        imu_motion,
        position_motion,
        velocity_motion,
    )

    rng = np.random.default_rng(2)
    t, gyro, accel, motion = drive(100.0, 25.0, seed=7)
    hole = np.r_[0:500, 560:1100, 1130 : len(t)]
    imu = imu_motion(imu_of(t[hole], gyro[hole], accel[hole], 3 * 10**9))
    fixes = fixes_of(t, motion, rate=2.0)
    gone = np.arange(len(fixes)) % 61 > 50
    fixes = replace(
        fixes,
        fix_type=np.where(gone, 0, fixes.fix_type),
        vel_ned=np.where((np.arange(len(fixes)) % 37 == 5)[:, None], np.nan, fixes.vel_ned),
    )
    fixes.lon_rad[9], fixes.gps_s[20] = np.nan, np.nan
    twice = Fixes(**{k: np.concatenate([v, v[30:40]])[::-1] for k, v in vars(fixes).items()})
    own = velocity_motion(fixes).shifted(-GPS_START)
    a, b = rng.normal(size=180), rng.normal(size=140)
    a[20:150] += 2.0 * b[:130]
    a[60:70], b[30:33] = np.nan, np.nan
    series, series_start = coarse._imu_series(imu)
    found: dict[str, Any] = {
        "motions": [
            f(log, w)
            for f in (velocity_motion, position_motion)
            for log in (fixes, twice)
            for w in (1.0, 0.4, 2.0)
        ],
        "short": [
            f(Fixes(**{k: v[:2] for k, v in vars(fixes).items()}))
            for f in (velocity_motion, position_motion)
        ],
        "parts": [imu.part(20.0, 40.0), own.part(20.0, 40.0)],
        "imu": imu,
        # which way the axes of a spread point is the library's to choose
        "series": [series[:, 0], np.abs(series[:, 1:]), series_start],
        "receiver": coarse._gnss_series(own),
        "like": [coarse._correlation(x, y, 512) for x, y in ((a, b), (b, a), (0.0 * a, b))],
    }
    weak = replace(
        own,
        turn=own.turn + rng.normal(0.0, 3.0, len(own.turn)),
        surge=np.full(len(own.surge), np.nan),
    )
    for name, other in (
        ("own", own),
        ("late", own.shifted(12.34)),
        ("weak", weak),
        ("early", own.shifted(-70.0)),
        ("half", own.part(5.0, 45.0)),
        ("few", own.part(5.0, 9.0)),
    ):
        found[name] = [coarse.find_offset(imu, other, reach) for reach in (None, 15.0, 0.5)]
        found[f"{name} lag"] = [
            correlation.refine_lag(imu, other, offset, half)
            for offset, half in ((0.0, 0.5), (-12.3, 0.5), (0.3, 0.8), (3.0, 0.4))
        ]
    brief = ImuMotion(imu.t_s[:9], imu.integral[:9])
    found["brief"] = [coarse.find_offset(brief, own), correlation.refine_lag(brief, own, 0.0, 0.5)]
    still = ImuMotion(imu.t_s, 0.0 * imu.integral)
    found["still"] = [
        coarse.find_offset(still, own),
        coarse.find_offset(imu, replace(own, turn=0.0 * own.turn, surge=0.0 * own.surge)),
    ]
    flat = imu_of(t[:60], gyro[:60], 0.0 * accel[:60], 0)
    found["flat"] = imu_motion(flat)
    n = 60
    start = 5.0 + np.cumsum(rng.uniform(0.4, 0.7, n))
    for is_turn in (True, False):
        channel = correlation.Channel(
            imu, start, start + 1.0, rng.uniform(3.0, 15.0, n), rng.normal(size=n), is_turn
        )
        lags = np.array([-0.3, 0.0, 0.2])
        found[f"channel {is_turn}"] = [channel.scores(lags), channel.sandwich(0.05, 0.012)]
        channel.reweight(0.1)
        found[f"again {is_turn}"] = [
            channel.weight,
            channel.noise,
            channel.scores(lags),
            channel.sandwich(0.05, 0.02),
            channel._reach(),
        ]
    found["channels"] = [len(c.target) for c in correlation.channels_between(imu, own, -0.5, 0.5)]
    found["nothing"] = coarse.find_offset(imu, GnssMotion(*[np.zeros(0)] * 5))
    return found


@scenario
def sync_words() -> Any:
    """What is said of receivers that contradict themselves, and which of their values go."""
    from automap.fusion.doubts import receiver
    from automap.fusion.doubts.own_velocities import own_velocities
    from automap.fusion.options import FusionOptions
    from automap.sync import velocity_findings as module
    from automap.sync.climb_match import Vertical
    from automap.sync.epoch_means import AFTER, AROUND, BEFORE, EpochMeans
    from automap.sync.path_match import Estimate, Match
    from automap.sync.unit_mistakes import unit_mistake

    fixes = simulated_fixes(2, Receiver(), 60.0)
    start = float(fixes.gps_s[0])
    spans = tuple(
        module.Interval(start + a, start + b, m)
        for a, b, m in ((5.0, 9.0, 3.0), (20.0, 31.0, 40.0))
    )
    plain = module.VelocityConsistency(
        100.0, Match(), False, None, False, (), (), (), (), None, 1.0
    )

    def matched(**changes: Any) -> Any:
        return replace(plain, match=replace(Match(scale=Estimate(1.0, 0.01)), **changes))

    scales = (
        3.6,
        0.28,
        1.94,
        0.6,
        1.67,
        0.595,
        1.1,
        0.9,
        1.03,
        30.0,
        100.0,
        3.28,
        0.001,
        0.45,
        -1.0,
    )
    cases = {
        f"unit {s} {sd}": replace(
            matched(scale=Estimate(s, sd)),
            unit=unit_mistake(Estimate(s, sd))[0],
            scale_wrong=unit_mistake(Estimate(s, sd))[1],
        )
        for s in scales
        for sd in (0.003, 0.03, 0.3)
    }
    cases |= {
        f"turned {m} {q}": matched(mirrored=m, quarters=q, turn_nats=37.0)
        for m in (False, True)
        for q in range(4)
    }
    for turn, sd in ((0.06, 0.005), (0.06, 0.02), (0.04, 0.001), (-0.3, 0.01)):
        cases[f"course {turn} {sd}"] = matched(turn_rad=Estimate(turn, sd))
        cases[f"wrong {turn} {sd}"] = replace(
            matched(turn_rad=Estimate(turn, sd)), scale_wrong=True
        )
    for speed, course in (
        ((-0.5, 0.01), (-0.4, 0.02)),
        ((-0.5, 0.05), (-0.3, 0.2)),
        ((-0.14, 0.001), (-0.4, 0.01)),
        ((-0.5, 0.01), (0.1, 0.02)),
        ((0.6, 0.01), (0.4, 0.02)),
    ):
        late = matched(speed_lag_s=Estimate(*speed), course_lag_s=Estimate(*course))
        cases[f"late {speed} {course}"] = late
        cases[f"late wrong {speed}"] = replace(late, scale_wrong=True)
        cases[f"late speed {speed}"] = replace(late, match=replace(late.match, course_lag_s=None))
    cases |= {
        "stuck": replace(plain, velocity_stuck=spans, worse=2.0),
        "frozen": replace(plain, position_frozen=spans[:1]),
        "rows": replace(plain, rows_frozen=spans[1:]),
        "parted": replace(plain, parted=spans, aside=spans[:1], unrelated=True, worse=9.0),
        "level": replace(plain, height_stuck=True, vertical=Vertical(None, False, 0.0, True)),
        "down": replace(plain, vertical=Vertical(Estimate(-1.0, 0.1), True, 44.0, False)),
    }
    for interval in (BEFORE, AFTER, AROUND):
        cases[interval] = replace(plain, means=EpochMeans(interval, 1, 0.25, 0.013, 55.0))
    names = (
        "can_tell",
        "turned",
        "sign_turned",
        "course_off",
        "may_be_minutes",
        "positions_late_s",
    )
    found: dict[str, Any] = {}
    for name, case in cases.items():
        found[name] = {
            "is": " ".join(f"{getattr(case, n)}" for n in names),
            "reasons": [f"{r.code}: {r.text}" for r in case.reasons],
            "doubts": [
                [str(r.as_dict()), r]
                for f in (False, True)
                for r in receiver.receiver_doubts(case, start, f)
            ],
        }
    some = (
        "unit 3.6 0.003",
        "turned True 1",
        "turned True 2",
        "course -0.3 0.01",
        "stuck",
        "frozen",
        "rows",
        "level",
        "down",
        "before",
        "late (-0.5, 0.01) (-0.4, 0.02)",
        "late (0.6, 0.01) (0.4, 0.02)",
    )
    holes = replace(
        fixes, vel_ned=np.where((np.arange(len(fixes)) % 23 == 3)[:, None], np.nan, fixes.vel_ned)
    )
    for name in some:
        case = cases[name]
        found[f"{name} used"] = [
            case.unusable_velocity(holes),
            case.unusable_vertical_velocity(holes),
            case.unusable_position(holes),
            receiver.usable_fixes(holes, case),
            own_velocities(holes, case),
            receiver.dated_velocities(holes, case),
        ]
    path = wavy_path(300, 0.4, 3)
    sure = fixes_on(path, 2)
    found["accuracy"] = [
        [
            str(r.as_dict())
            for r in receiver.accuracy_doubts(
                replace(sure, sd_pos_ned=s * sure.sd_pos_ned, fix_type=np.full(150, 3)),
                FusionOptions(),
            )
        ]
        for s in (1.0, 0.5, 0.1)
    ]
    return found


@scenario
def sync_held() -> Any:
    """Values that a log repeats, and the two paths of a receiver in windows."""
    from automap.sync import climb_match, held_values, parting, path_match
    from automap.sync.receiver_path import receiver_path, velocity_sd, windows

    fixes = simulated_fixes(5, Receiver(rate_hz=4.0), 120.0)
    t = fixes.gps_s - fixes.gps_s[0]
    stretch = damage.driving(fixes, 12.0)
    gone = (t > 50.0) & (t < 56.0)
    slow = Fixes(**{k: v[::8] for k, v in vars(fixes).items()})
    fast = int(np.argmax(np.hypot(slow.vel_ned[:, 0], slow.vel_ned[:, 1])))
    logs = {
        "sound": fixes,
        "places": damage.held(fixes, stretch, "lat_rad", "lon_rad"),
        "speeds": damage.held(fixes, stretch, "vel_ned"),
        "zero": damage.zeroed(fixes, stretch),
        "rows": damage.held(fixes, stretch, "lat_rad", "lon_rad", "vel_ned"),
        "end": damage.held(fixes, t > t[-1] - 9.0, "lat_rad", "lon_rad", "vel_ned"),
        "begin": damage.held(fixes, t < 8.0, "lat_rad", "lon_rad", "vel_ned"),
        "once": damage.held(slow, np.arange(len(slow)) == fast, "lat_rad", "lon_rad"),
        "twice": damage.held(slow, np.abs(np.arange(len(slow)) - fast) < 1.1, "lat_rad", "vel_ned"),
        "gone": replace(fixes, vel_ned=np.where(gone[:, None], np.nan, fixes.vel_ned)),
    }
    found: dict[str, Any] = {}
    for name, log in logs.items():
        path = receiver_path(log)
        use = np.isfinite(path.velocity)
        right = path_match.Match(factor=1.1 - 0.2j).path(path, use)
        velocity = path_match.Match(factor=0.9 + 0.1j, mirrored=True).velocity(path)
        frozen = np.arange(len(path)) % 7 == 2
        over = windows(path, use, 6.0, np.arange(len(path)) % 3 > 0)
        found[name] = {
            "long": held_values.in_long_repeats(path),
            "frozen": [
                held_values.frozen_positions(path, r, np.where(use, velocity, 0.0), w)
                for r in (right, path.place)
                for w in (1.0, 9.0)
            ],
            "stuck": [held_values.stuck_velocities(path, right, frozen, w) for w in (1.0, 5.0)],
            "digit": held_values._digit_m(path),
            "parted": [parting.partings(path, right, use, ~frozen, w) for w in (0.3, 1.0)],
            "jumps": [
                held_values._jump_after(path, right, a, b)
                for a, b in ((3, 9), (len(path) // 2, len(path) - 1))
            ],
            "windows": over,
            "sd": velocity_sd(path, over),
            "match": [
                path_match.match_paths(path, use, ~frozen),
                path_match.match_paths(path, use & ~frozen, use),
            ],
        }
    often = Fixes(**{k: np.repeat(v, 3, axis=0) for k, v in vars(fixes).items()})
    often = replace(often, gps_s=fixes.gps_s[0] + np.arange(len(often)) / 12.0)
    found["again"] = [held_values.told_again(log) for log in (often, fixes, logs["rows"])]
    path = receiver_path(fixes)
    rng = np.random.default_rng(4)
    seen = rng.normal(size=60) + 1j * rng.normal(size=60)
    seen[7] += 30.0
    other, sd = (0.4 + 0.9j) * seen + 0.1 * rng.normal(size=60), rng.uniform(0.2, 0.6, 60)
    found["scale"] = [
        path_match._best_scale(s, o, sd)
        for s, o in ((seen, other), (seen, 0.0 * other), (-seen, other), (3.0 * other, other))
    ]
    score, cov = rng.normal(size=(60, 4)), np.diag([1.0, 2.0, 3.0, 4.0]) + 0.2
    rising = 3.0 * np.sin(np.arange(40.0))
    found["climb"] = [
        climb_match._scale(
            factor * rising + 0.1 * np.cos(np.arange(40.0)), rising, np.full(40, size)
        )
        for factor in (0.3, 1.0, -2.0, 0.0)
        for size in (0.2, 9.0)
    ]
    found["spread"] = [
        path_match._spread(np.sort(rng.uniform(0.0, s, 60)), score, cov) for s in (200.0, 30.0, 3.0)
    ]
    turned = {
        k: damage.redirected(damage.scaled(fixes, 1.4), m)
        for k, m in (
            ("mirror", [[-1.0, 0.0], [0.0, 1.0]]),
            ("swap", [[0.0, 1.0], [1.0, 0.0]]),
            ("quarter", [[0.0, -1.0], [1.0, 0.0]]),
            ("turn", [[0.9, -0.2], [0.2, 0.9]]),
        )
    }
    late = simulated_fixes(5, Receiver(rate_hz=2.0, speed_lag_s=0.7, course_lag_s=0.3), 120.0)
    for name, log in (
        turned | {"late": late, "few": Fixes(**{k: v[:60] for k, v in vars(fixes).items()})}
    ).items():
        path = receiver_path(log)
        all_rows = np.ones(len(path), bool)
        found[f"matched {name}"] = path_match.match_paths(path, all_rows, all_rows)
    return found


@scenario
def sync_steps() -> Any:
    """Steps of delays of all sizes, at the ends and in the middle, of few points and many."""
    from automap.sync import steps
    from automap.sync.finished import trajectory_clock
    from automap.sync.logger_clock import on_logger_clock

    rng = np.random.default_rng(5)
    found: dict[str, Any] = {}
    for many in (29, 31, 60, 300):
        x = np.sort(rng.uniform(0.0, 400.0, many))
        for size in (0.0, 0.015, 0.03, 0.2, -0.5):
            for share in (0.02, 0.3, 0.51, 0.97):
                y = rng.exponential(0.003, many) + 2e-5 * x + size * (x > 400.0 * share)
                found[f"{many} {size} {share}"] = steps.find_step(x, y)
    x, level = (
        np.arange(30.0),
        np.where(np.arange(30) > 14, 1.0, 0.0) + 0.01 * np.sin(np.arange(30.0)),
    )
    ends = np.zeros(3), np.ones(4)
    found["boundary"] = [
        steps._boundary(x, value, bins, split, *ends)
        for value in (level, 1.0 - level, 0.0 * level, 0.0 * level + 1.0)
        for bins, split in (
            (np.arange(2.0, 30.0, 4.0), 3),
            (np.arange(2.0, 30.0, 4.0), 1),
            (np.array([40.0, 41.0, 42.0]), 2),
        )
    ]
    found["slopes"] = steps._candidate_slopes(x[::4], level[::4])
    found["cost"] = steps._cost(rng.normal(size=(4, 9)))
    stamp = np.rint(np.arange(0.0, 30.0, 0.1) * 1e9).astype(np.int64)
    for rate, noise in ((1e-5, 1e-3), (9e-4, 0.0), (1.2e-3, 0.0), (0.0, 0.4), (0.0, 0.6)):
        gps = 1.4e9 + stamp * 1e-9 * (1.0 + rate) + rng.normal(0.0, noise, len(stamp))
        found[f"rows {rate} {noise}"] = told(trajectory_clock, stamp, gps)
    found["row"] = trajectory_clock(stamp[:1], np.array([1.4e9]))
    for late in (0.3, 1.9, 2.1):
        heard = stamp + np.rint(late * rng.uniform(0.0, 1.0, len(stamp)) * 1e9).astype(np.int64)
        heard[[3, 4]] = stamp[3] + np.int64(late * 1e9), stamp[4]
        found[f"heard {late}"] = told(on_logger_clock, stamp, heard)
    found["no time"] = [told(on_logger_clock, 0 * stamp, stamp), NO_TIME]
    return found
