"""Accuracy and honesty of the fusion over many simulated drives.

    python tests/benchmarks/fusion_monte_carlo.py [--drives N] [--seconds S]

Sensor errors are drawn from the priors, the receiver's error wanders. Printed: the smoothed
horizontal RMS against that of the exact optimal linear smoother on the same noise (with the
vehicle constraint and without), and over all drives the error over its sd by component and
the share of instants at which the mean NEES lies within the 95 % band.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np

from automap.frames import rotation_vector_to_matrix
from automap.fusion.engine import Prior, fuse_imu_gnss
from automap.fusion.options import FusionOptions
from automap.records import FloatArray
from tests.benchmarks.optimal_smoother import optimal_errors
from tests.unit.fusion_drive import (
    BASE_NS,
    CLOCK,
    GPS0,
    Receiver,
    Sensor,
    city_drive,
    errors,
    horizontal_rms,
    receive,
    record,
)

COMPONENTS = ("n", "e", "d", "vn", "ve", "vd", "phi_n", "phi_e", "phi_d")
EPOCH_S = 5.0
LEVER_SD, DELAY_SD = 0.05, 0.02
MOUNTING_SD = np.array([1e-3, 0.02, 0.02])


@dataclass(frozen=True)
class DriveOutcome:
    """Errors and sd [k, 9] every few seconds; horizontal RMS of ours, of the filter, of the
    optimum without and with the vehicle constraint, of the raw fixes."""

    error: FloatArray
    sd: FloatArray
    smoothed: float
    filtered: float
    optimal: float
    optimal_constrained: float
    raw: float


def draw_sensor(rng: np.random.Generator) -> Sensor:
    """A sensor whose errors have the spread of the catalogue's priors."""

    def triple(sd: float) -> tuple[float, float, float]:
        x, y, z = rng.normal(0.0, sd, 3)
        return float(x), float(y), float(z)

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
    )


def run_drive(seed: int, seconds: float, compare: bool = True) -> DriveOutcome:
    """Simulate and fuse one drive."""
    rng = np.random.default_rng(1000 + seed)
    motion = city_drive(seconds, seed, slip=True)
    sensor, receiver = draw_sensor(rng), Receiver()
    lever, delay = rng.normal(0.0, LEVER_SD, 3), float(rng.normal(0.0, DELAY_SD))
    mounting = rotation_vector_to_matrix(rng.normal(0.0, 1.0, 3) * MOUNTING_SD)
    mounted = record(motion, sensor, 2000 + seed, delay_s=delay, c_v_s=mounting)
    result = fuse_imu_gnss(
        replace(mounted, axes_known=True),
        receive(motion, replace(receiver, lever=tuple(lever)), 3000 + seed),
        CLOCK,
        FusionOptions(),
        Prior(0.0, DELAY_SD),
        lever_arm=np.zeros(3),
        lever_arm_sd=LEVER_SD,
    )
    # the optimum gets the same noise without what it does not model
    imu, fixes = record(motion, sensor, 2000 + seed), receive(motion, receiver, 3000 + seed)
    error = errors(result.trajectory, motion)
    sd = np.concatenate(
        [result.trajectory.sd_pos_ned, result.trajectory.sd_vel_ned, _tilt_sd(result.trajectory)],
        axis=1,
    )
    t = (result.trajectory.t_ns - BASE_NS) * 1e-9
    rows = np.searchsorted(t, np.arange(EPOCH_S, seconds - 1.0, EPOCH_S))
    optimal = constrained = np.nan
    if compare:
        best, _ = optimal_errors(motion, imu, fixes, sensor, receiver)
        optimal = horizontal_rms(best)
        best, _ = optimal_errors(motion, imu, fixes, sensor, receiver, nhc_sd=0.1)
        constrained = horizontal_rms(best)
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
        optimal,
        constrained,
        horizontal_rms(np.column_stack(off)),
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--drives", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--no-optimum", action="store_true", help="only the honesty figures")
    options = parser.parse_args()
    outcomes = []
    for seed in range(options.drives):
        o = run_drive(seed, options.seconds, not options.no_optimum)
        outcomes.append(o)
        print(
            f"drive {seed:2d}: smoothed {o.smoothed:.2f} m, filter {o.filtered:.2f}, optimum "
            f"{o.optimal:.2f}, with constraint {o.optimal_constrained:.2f}, raw {o.raw:.2f}",
            flush=True,
        )
    ours = pooled([o.smoothed for o in outcomes])
    best = pooled([o.optimal for o in outcomes])
    constrained = pooled([o.optimal_constrained for o in outcomes])
    print(
        f"pooled: {ours:.3f} m, optimum {best:.3f} (ratio {ours / best:.3f}), with the vehicle "
        f"constraint {constrained:.3f} (ratio {ours / constrained:.3f}), target 1.15"
    )
    for name, value in zip(COMPONENTS, sigma_ratios(outcomes), strict=True):
        print(f"  rms(error / sd) {name:6s} {value:.3f}  (0.9 .. 1.1)")
    mean, inside = nees(outcomes)
    for name, m, share in zip(("position", "velocity", "attitude"), mean, inside, strict=True):
        print(f"  NEES {name}: {m:.3f} per degree of freedom, {100 * share:.0f} % in the 95 % band")


if __name__ == "__main__":
    main()
