"""Accuracy and honesty of the fusion over many simulated drives.

    python tests/benchmarks/fusion_monte_carlo.py [--receiver NAME]... [--drives N] [--seconds S]

Sensor errors are drawn from the priors; the receiver is one of ``configs/receivers`` (phone,
u-blox) as far as it is linear and Gaussian, or "white": white velocity errors, a wandering position
and true accuracies. Without a choice both "white" and "phone" are driven. Printed: the smoothed
horizontal RMS against that of the exact optimal linear smoother on the same noise (with the
vehicle constraint and without), which knows the receiver's model and delays; and over all drives
the error over its sd by component and the mean NEES with the band that so many independent errors
allow. What misses its aim is marked. Of "white" it is stated, as of a receiver whose kind is known,
that its fixes are of their tags and that no part of its error outlasts a drive; with ``--unknown``
nothing is, as in a plain run.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np

from automap.frames import rotation_vector_to_matrix
from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.options import FusionOptions
from automap.fusion.result import Prior
from automap.records import FloatArray
from tests.benchmarks.optimal_smoother import optimal_errors
from tests.unit.fusion_drive import BASE_NS, CLOCK, Sensor, errors, horizontal_rms, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import GPS0, WHITE, Receiver, receive, receiver_named

COMPONENTS = ("n", "e", "d", "vn", "ve", "vd", "phi_n", "phi_e", "phi_d")
EPOCH_S = 5.0
LEVER_SD, DELAY_SD, ANGLE_SD = 0.05, 0.02, 0.01
MOUNTING_SD = np.array([1e-3, 0.02, 0.02])
DEFAULT = (WHITE, "phone")
GREATEST_RATIO = {WHITE: 1.03}
GREATEST_RATIO_REAL = 1.10
"""Of our error to the optimum's: what has to be found out (accuracies, delays, mounting) costs."""
SIGMA_BAND = (0.9, 1.1)
KNOWN_WHITE = FusionOptions(bias_share=0.0, fixed={"gnss_latency": {"s": 0.0}})
MOTION_MEMORY_S = 10.0
"""Errors of velocity and attitude forget each other in about such a time: a turn or two."""


@dataclass(frozen=True)
class DriveOutcome:
    """Errors and sd [k, 9] every few seconds; horizontal RMS of ours, of the filter, of the
    optimum without and with the vehicle constraint, of the raw fixes; and of those two optima the
    RMS that they expect of themselves, and how far ours lies from them."""

    error: FloatArray
    sd: FloatArray
    smoothed: float
    filtered: float
    optimal: float
    optimal_constrained: float
    raw: float
    expected: tuple[float, float] = (np.nan, np.nan)
    apart: tuple[float, float] = (np.nan, np.nan)


def draw_sensor(rng: np.random.Generator) -> Sensor:
    """A sensor whose errors have the spread of the catalogue's priors."""

    def triple(sd: float) -> tuple[float, float, float]:
        x, y, z = rng.normal(0.0, sd, 3)
        return float(x), float(y), float(z)

    # from a stream of their own: all else is as without them
    angles = rng.spawn(1)[0].normal(0.0, ANGLE_SD, 9).tolist()
    return Sensor(
        gyro_noise=3e-4,
        accel_noise=5e-3,
        gyro_bias=triple(0.02),
        accel_bias=triple(0.3),
        gyro_scale=triple(0.01),
        accel_scale=triple(0.01),
        gyro_walk=1e-5,
        accel_walk=4e-4,
        vibration=0.08,
        gyro_angles=tuple(angles[:6]),
        accel_angles=tuple(angles[6:]),
    )


def run_drive(
    seed: int,
    seconds: float,
    compare: bool = True,
    receiver: Receiver | None = None,
    options: FusionOptions | None = None,
) -> DriveOutcome:
    """Simulate and fuse one drive."""
    rng = np.random.default_rng(1000 + seed)
    motion = city_drive(seconds, seed, slip=True)
    sensor, receiver = draw_sensor(rng), receiver or Receiver()
    lever, delay = rng.normal(0.0, LEVER_SD, 3), float(rng.normal(0.0, DELAY_SD))
    mounting = rotation_vector_to_matrix(rng.normal(0.0, 1.0, 3) * MOUNTING_SD)
    mounted = record(motion, sensor, 2000 + seed, delay_s=delay, c_v_s=mounting)
    result = fuse_imu_gnss(
        replace(mounted, axes_known=True),
        receive(motion, replace(receiver, lever=tuple(lever)), 3000 + seed),
        CLOCK,
        replace(options or FusionOptions(), nhc_lasting_deg=0.0),  # this car has no such slip
        Prior(0.0, DELAY_SD),
        lever_arm=np.zeros(3),
        lever_arm_sd=LEVER_SD,
    )
    # the optimum gets the same noise without what it does not model
    prompt = replace(receiver, latency=0.0, vel_latency=0.0, course_latency=0.0)
    straight = replace(sensor, gyro_angles=(0.0,) * 6, accel_angles=(0.0,) * 3)
    imu, fixes = record(motion, straight, 2000 + seed), receive(motion, prompt, 3000 + seed)
    error = errors(result.trajectory, motion)
    sd = np.concatenate(
        [result.trajectory.sd_pos_ned, result.trajectory.sd_vel_ned, _tilt_sd(result.trajectory)],
        axis=1,
    )
    t = (result.trajectory.t_ns - BASE_NS) * 1e-9
    rows = np.searchsorted(t, np.arange(EPOCH_S, seconds - 1.0, EPOCH_S))
    near = np.searchsorted(t, fixes.gps_s - GPS0 - 1e-3)
    at_fixes = error[np.minimum(near, len(t) - 1)]
    rms, expected, apart = [np.nan] * 2, [np.nan] * 2, [np.nan] * 2
    for i, nhc_sd in enumerate((None, 0.1) if compare else ()):
        best, spread = optimal_errors(motion, imu, fixes, sensor, receiver, nhc_sd=nhc_sd)
        rms[i], expected[i] = horizontal_rms(best), horizontal_rms(spread)
        apart[i] = horizontal_rms(at_fixes - best)
    true = motion.at(fixes.gps_s - GPS0)
    off = (
        (fixes.lat_rad - true.lat) * 6.37e6,
        (fixes.lon_rad - true.lon) * 6.37e6 * np.cos(true.lat),
    )
    return DriveOutcome(
        error[rows],
        sd[rows],
        horizontal_rms(error),
        horizontal_rms(errors(result.filtered, motion)),
        rms[0],
        rms[1],
        horizontal_rms(np.column_stack(off)),
        (expected[0], expected[1]),
        (apart[0], apart[1]),
    )


def _tilt_sd(trajectory: object) -> FloatArray:
    """Sd of the rotation error about north, east, down from that of roll, pitch, yaw."""
    rpy, sd = trajectory.rpy, trajectory.sd_rpy  # type: ignore[attr-defined]
    c, s = np.cos(rpy[:, 2]), np.sin(rpy[:, 2])
    north = np.hypot(c * sd[:, 0], s * sd[:, 1])
    east = np.hypot(s * sd[:, 0], c * sd[:, 1])
    return np.stack([north, east, sd[:, 2]], axis=1)


def pooled(values: list[float]) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


def expected_ratio(outcomes: list[DriveOutcome], which: int) -> float:
    """What the ratio of our RMS to an optimum's tends to over many drives, from a few.

    An optimal estimate's error is uncorrelated with all that can be made of the same data, the
    distance of ours from it among that: the squares add up (Anderson and Moore, Optimal Filtering,
    section 5.2).
    """
    best = pooled([o.expected[which] for o in outcomes])
    return float(np.hypot(1.0, pooled([o.apart[which] for o in outcomes]) / best))


def sigma_ratios(outcomes: list[DriveOutcome]) -> FloatArray:
    """RMS of error over sd [9] over all drives and instants."""
    ratio = np.concatenate([o.error / o.sd for o in outcomes])
    return np.asarray(np.sqrt(np.mean(ratio**2, axis=0)))


def nees(outcomes: list[DriveOutcome]) -> tuple[FloatArray, FloatArray]:
    """Mean NEES per degree of freedom of position, velocity, attitude [3], and the share [3]
    of instants at which the mean over drives lies within the two-sided 95 % band."""
    from scipy.stats import chi2

    k = min(len(o.error) for o in outcomes)
    squares = np.stack([(o.error[:k] / o.sd[:k]) ** 2 for o in outcomes])
    blocks = squares.reshape(len(outcomes), k, 3, 3).sum(axis=3)
    mean = blocks.mean(axis=0)
    dof = 3 * len(outcomes)
    low, high = chi2.ppf([0.025, 0.975], dof) / len(outcomes)
    return mean.mean(axis=0) / 3.0, ((mean > low) & (mean < high)).mean(axis=0)


def nees_bands(receiver: Receiver, drives: int, seconds: float) -> list[tuple[float, float]]:
    """Within which 95 % of the mean NEES per degree of freedom lie, of position, velocity and
    attitude: a wandering error is drawn anew about every two time constants."""
    from scipy.stats import chi2

    slow = [t for sd, t in zip(receiver.slow, receiver.slow_tau, strict=True) if sd > 0.0]
    longest = max([receiver.tau, *slow])
    bands = []
    for memory in (longest, MOTION_MEMORY_S, MOTION_MEMORY_S):
        dof = 3.0 * drives * (1.0 + seconds / (2.0 * memory))
        low, high = chi2.ppf([0.025, 0.975], dof) / dof
        bands.append((float(low), float(high)))
    return bands


def report(name: str, outcomes: list[DriveOutcome], seconds: float) -> None:
    """Print the figures of a receiver's drives, each with its aim."""
    ours = pooled([o.smoothed for o in outcomes])
    aim = GREATEST_RATIO.get(name, GREATEST_RATIO_REAL)
    kinds = {"": "optimal", " with the vehicle constraint": "optimal_constrained"}
    print(f"{name}, {len(outcomes)} drives of {seconds:.0f} s: {ours:.3f} m")
    for i, (kind, field) in enumerate(kinds.items()):
        best = pooled([getattr(o, field) for o in outcomes])
        mark = _mark(not ours / best <= aim)
        print(
            f"  optimum{kind} {best:.3f} m, ratio {ours / best:.3f} (at most {aim:.2f}){mark}, "
            f"{expected_ratio(outcomes, i):.3f} by the distance from it"
        )
    low, high = SIGMA_BAND
    for component, value in zip(COMPONENTS, sigma_ratios(outcomes), strict=True):
        mark = _mark(not low <= value <= high)
        print(f"  rms(error / sd) {component:6s} {value:.3f}  ({low} .. {high}){mark}")
    mean, inside = nees(outcomes)
    bands = nees_bands(receiver_named(name), len(outcomes), seconds)
    names = ("position", "velocity", "attitude")
    for block, value, share, (low, high) in zip(names, mean, inside, bands, strict=True):
        mark = _mark(not low <= value <= high)
        print(
            f"  NEES {block}: {value:.3f} per degree of freedom ({low:.2f} .. {high:.2f}){mark}, "
            f"{100 * share:.0f} % of instants in the 95 % band"
        )


def stated(receiver_name: str) -> FusionOptions | None:
    """What is told to the fusion of a receiver's kind; None for nothing."""
    return KNOWN_WHITE if receiver_name == WHITE else None


def _mark(missed: bool) -> str:
    return " MISSED" if missed else ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--receiver", action="append", help="white, phone, u-blox; repeatable")
    parser.add_argument("--drives", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--unknown", action="store_true", help="nothing stated of the receiver")
    parser.add_argument("--no-optimum", action="store_true", help="only the honesty figures")
    options = parser.parse_args()
    for name in options.receiver or DEFAULT:
        outcomes = []
        for seed in range(options.drives):
            known = None if options.unknown else stated(name)
            receiver = receiver_named(name)
            o = run_drive(seed, options.seconds, not options.no_optimum, receiver, known)
            outcomes.append(o)
            print(
                f"{name} {seed:2d}: smoothed {o.smoothed:.2f} m, filter {o.filtered:.2f}, optimum "
                f"{o.optimal:.2f}, with constraint {o.optimal_constrained:.2f}, raw {o.raw:.2f}",
                flush=True,
            )
        report(name, outcomes, options.seconds)


if __name__ == "__main__":
    main()
