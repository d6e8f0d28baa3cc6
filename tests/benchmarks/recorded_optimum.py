"""The optimal linear smoother on the fixes of recorded drives with a reference.

    python tests/benchmarks/recorded_optimum.py DRIVES OUTS

``DRIVES`` is the folder of the drive folders, ``OUTS`` that of their results (fixes.parquet,
trajectory.parquet). Each fix carries a Gauss-Markov and a white error, and between fixes
the position moves as the fixes' own velocities say: that is all a linear smoother has, and the
first optimum. For the second the velocities get the reference's motion and only their noise: so
it would be, did the reference's velocities integrate to its positions. For the third relative
motion is known exactly. Printed: the horizontal RMS by drive and pooled by length, of the
fixes, of the three and of ours; and the NEES of our positions over all drives together, within
the band that so many independent errors allow: a wandering error is drawn anew about every two
time constants.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.earth import local_ned
from automap.evaluation.trajectory_errors import path_length, trajectory_errors
from automap.interpolation import poses_at_gps
from automap.io.tables import read_fixes
from automap.io.trajectory_table import read_trajectory
from automap.io.truth_trajectory import read_truth_trajectory
from automap.records import FloatArray

WANDER_SD, TAU_S, WHITE_SD, VELOCITY_SD = 1.0, 60.0, 0.3, 0.07


def smooth_axis(t: FloatArray, z: FloatArray, move: FloatArray, move_sd: float) -> FloatArray:
    """Smoothed position errors [k] of one axis.

    ``z`` [k] errors of the fixes in m; between epochs the estimate moves by ``move`` [k] m
    against the truth, known to ``move_sd`` m per root of the steps.
    """
    k = len(t)
    x, p = np.zeros(2), np.diag([100.0**2, WANDER_SD**2])
    xs, ps, xp, pp = np.zeros((k, 2)), np.zeros((k, 2, 2)), np.zeros((k, 2)), np.zeros((k, 2, 2))
    f = np.zeros((k, 2, 2))
    h = np.ones(2)
    for i in range(k):
        d = np.exp(-(t[i] - t[i - 1]) / TAU_S) if i else 1.0
        f[i] = np.diag([1.0, d])
        x = f[i] @ x + np.array([move[i] if i else 0.0, 0.0])
        p = f[i] @ p @ f[i] + np.diag([move_sd**2 if i else 0.0, (1 - d * d) * WANDER_SD**2])
        xp[i], pp[i] = x, p
        ph = p @ h
        s = float(h @ ph) + WHITE_SD**2
        x, p = x + ph * (z[i] - h @ x) / s, p - np.outer(ph, ph) / s
        xs[i], ps[i] = x, p
    for i in range(k - 2, -1, -1):
        gain = np.linalg.solve(pp[i + 1], f[i + 1] @ ps[i]).T
        xs[i] += gain @ (xs[i + 1] - xp[i + 1])
    return xs[:, 0]


@dataclass(frozen=True)
class DriveFigures:
    """Length in m; horizontal RMS in m of fixes, of the three optima, of ours; mean squared
    error over variance by axis [3] NED; number of independent errors."""

    length: float
    rms: list[float]
    nees: FloatArray
    draws: float


def drive_figures(drive: Path, out: Path) -> DriveFigures:
    """Figures of one drive and its results."""
    truth = read_truth_trajectory(drive / "truth" / "trajectory.csv")
    fixes = read_fixes(out / "fixes.parquet")
    poses = poses_at_gps(truth, fixes.gps_s)
    use = poses.covered & np.isfinite(fixes.lat_rad)
    t = fixes.gps_s[use]
    north = (fixes.lat_rad[use] - poses.lat_rad[use]) * 6.37e6
    east = (fixes.lon_rad[use] - poses.lon_rad[use]) * 6.38e6 * np.cos(poses.lat_rad[use])
    noise = np.nan_to_num(fixes.vel_ned[use, :2] - poses.vel_ned[use, :2])
    step = np.diff(t, prepend=t[0])[:, None]
    move = 0.5 * step * (noise + np.roll(noise, 1, axis=0))
    velocity = np.nan_to_num(fixes.vel_ned[use, :2])
    place = local_ned(
        poses.lat_rad[use],
        poses.lon_rad[use],
        np.zeros(len(t)),
        (float(poses.lat_rad[use][0]), float(poses.lon_rad[use][0]), 0.0),
    )[:, :2]
    travelled = 0.5 * step * (velocity + np.roll(velocity, 1, axis=0))
    measured = travelled - np.diff(place, axis=0, prepend=place[:1])
    measured[0] = 0.0
    rms = []
    sd_move = VELOCITY_SD * float(np.median(step[1:]))
    for moves, sd in ((measured, sd_move), (move, sd_move), (0.0 * move, 0.0)):
        axes = [smooth_axis(t, z, moves[:, i], sd) for i, z in enumerate((north, east))]
        rms.append(float(np.sqrt(np.mean(axes[0] ** 2 + axes[1] ** 2))))
    errors = trajectory_errors(read_trajectory(out / "trajectory.parquet"), truth)
    ours = errors.error
    own = float(np.sqrt(np.nanmean(ours[:, 0] ** 2 + ours[:, 1] ** 2)))
    raw = float(np.sqrt(np.mean(north**2 + east**2)))
    nees = np.nanmean((ours[:, :3] / errors.sd[:, :3]) ** 2, axis=0)
    draws = 1.0 + errors.span_s / (2.0 * TAU_S)
    return DriveFigures(path_length(truth), [raw, *rms, own], nees, draws)


def print_consistency(drives: list[DriveFigures]) -> None:
    """NEES of all drives together, every independent error counted once."""
    from scipy.stats import chi2

    draws = np.array([drive.draws for drive in drives])
    nees = np.stack([drive.nees for drive in drives])
    by_axis = draws @ nees / draws.sum()
    total = float(draws.sum())
    rows = [(axis, float(by_axis[i]), total) for i, axis in enumerate(("north", "east", "down"))]
    for name, value, k in [*rows, ("all axes", float(by_axis.mean()), 3.0 * total)]:
        low, high = (float(chi2.ppf(p, k)) / k for p in (0.025, 0.975))
        print(f"NEES {name}: {value:.2f} a degree of freedom, 95 % band {low:.2f} to {high:.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("drives", type=Path)
    parser.add_argument("outs", type=Path)
    options = parser.parse_args()
    found = []
    for drive in sorted(options.drives.glob("kitti-*")):
        figures = drive_figures(drive, options.outs / drive.name)
        found.append(figures)
        print(
            f"{drive.name}: "
            + "fixes {:.2f}, optimum {:.2f}, with the reference's motion {:.2f}, with exact motion "
            "{:.2f}, ours {:.2f} m".format(*figures.rms)
            + ", NEES {:.2f} {:.2f} {:.2f}".format(*figures.nees)
        )
    weight = np.array([figures.length for figures in found])[:, None]
    rows = [figures.rms for figures in found]
    raw, optimum, reference, exact, ours = np.sqrt(
        np.sum(weight * np.square(rows), axis=0) / weight.sum()
    )
    print(
        f"pooled: fixes {raw:.3f}, optimum {optimum:.3f}, with the reference's motion "
        f"{reference:.3f}, with exact motion {exact:.3f}, ours {ours:.3f} m; ratio to the first "
        f"{ours / optimum:.3f} (target 1.2), to the second {ours / reference:.3f}"
    )
    print_consistency(found)


if __name__ == "__main__":
    main()
