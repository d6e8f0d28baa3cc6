"""What simulated receivers have wrong, beside what recorded ones have.

    python tests/benchmarks/receivers.py DRIVE... [--receiver NAME]... [--seeds N]

Each ``DRIVE`` is a folder with fixes and truth. The receivers of ``configs/receivers`` (phone where
none is named) are simulated along the first one's path, N times, and their fixes are compared with
the truth by the same code as the recorded ones. Printed as a table: by receiver and quantity the
RMS and the correlation after some seconds, about zero; for velocities where the vehicle moves, net
of the receiver's delays, which stand in a line of their own.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.evaluation.fix_errors import fix_errors
from automap.interpolation import poses_at_gps
from automap.io import names
from automap.io.truth_trajectory import read_truth_trajectory
from automap.records import FixErrors, FloatArray, Trajectory
from automap.simulation.errors import error_values
from automap.simulation.gnss import receive
from automap.simulation.scenario import Scenario
from automap.simulation.twin import motion_along
from pipeline.simulate.receivers import with_receiver
from pipeline.simulate.replay import recorded_errors

LAGS_S = (1, 2, 5, 10, 20, 40)
QUANTITIES = ("north", "east", "down", "velocity along", "velocity across")
LEAST_SPEED = 3.0
"""m/s; slower, courses mean little."""


@dataclass(frozen=True)
class Figures:
    """RMS [5] by quantity and correlations [5, 6] by lag; delays of speed and course, s."""

    rms: FloatArray
    correlation: FloatArray
    delays: tuple[float, float]


def figures(errors: FixErrors, truth: Trajectory) -> Figures:
    """Of a receiver's errors, on a grid of whole seconds."""
    speed = np.linalg.norm(poses_at_gps(truth, errors.gps_s).vel_ned, axis=1)
    moving = np.where(speed > LEAST_SPEED, 1.0, np.nan)[:, None]
    values = np.column_stack([errors.position, errors.velocity[:, :2] * moving])
    second = np.rint(errors.gps_s - errors.gps_s[0]).astype(int)
    whole = np.flatnonzero(np.abs(errors.gps_s - errors.gps_s[0] - second) < 0.01)
    grid = np.full((second[-1] + 1, values.shape[1]), np.nan)
    grid[second[whole]] = values[whole]
    rms = np.sqrt(np.nanmean(grid**2, axis=0))
    correlation = np.stack([_correlation(grid, lag) for lag in LAGS_S], axis=1)
    return Figures(rms, correlation, (errors.speed_delay_s, errors.course_delay_s))


def _correlation(x: FloatArray, lag: int) -> FloatArray:
    a, b = x[:-lag], x[lag:]
    both = np.isfinite(a) & np.isfinite(b)
    a, b = np.where(both, a, 0.0), np.where(both, b, 0.0)
    size = np.sqrt(np.sum(a * a, axis=0) * np.sum(b * b, axis=0))
    return np.asarray(np.sum(a * b, axis=0) / size)


def simulated(name: str, truth: Trajectory, seeds: int) -> Figures:
    """The mean figures of a receiver of that name along the truth's path."""
    start = {"utc": "2026-03-14T09:20:00Z", "lat_deg": 0.0, "lon_deg": 0.0}
    bare = {"schema": "automap.scenario/1", "name": name, "start": start}
    content = {**bare, "route": {"legs": [{"length_m": 1.0}]}, "gnss": {"receiver": name}}
    scenario = Scenario.model_validate(with_receiver(content))
    assert scenario.gnss is not None
    motion, begin = motion_along(truth), float(truth.gps_s[0])
    found = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        fixes, _ = receive(motion, scenario.gnss, begin, rng, error_values(scenario.errors))
        found.append(figures(fix_errors(fixes, truth, np.zeros(3)), truth))
    rms = np.sqrt(np.mean([f.rms**2 for f in found], axis=0))
    speed, course = np.mean([f.delays for f in found], axis=0)
    correlation = np.mean([f.correlation for f in found], axis=0)
    return Figures(rms, correlation, (float(speed), float(course)))


def rows(name: str, found: Figures) -> list[str]:
    """The lines of a receiver in the table."""
    lines = []
    for i, quantity in enumerate(QUANTITIES):
        unit = "m/s" if quantity.startswith("velocity") else "m"
        after = " | ".join(f"{r:.2f}" for r in found.correlation[i])
        lines.append(f"| {name} | {quantity} | {found.rms[i]:.2f} {unit} | {after} |")
    speed, course = found.delays
    return [*lines, f"| {name} | delays | speed {speed:.2f} s, course {course:.2f} s |" + " |" * 6]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("drives", type=Path, nargs="+")
    parser.add_argument("--receiver", action="append", help="of configs/receivers; repeatable")
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    print("| receiver | error | RMS | " + " | ".join(f"{lag} s" for lag in LAGS_S) + " |")
    print("|" + "---|" * (3 + len(LAGS_S)))
    truths = [
        read_truth_trajectory(d / names.TRUTH_DIR / names.TRUTH_TRAJECTORY) for d in options.drives
    ]
    for drive, truth in zip(options.drives, truths, strict=True):
        print("\n".join(rows(drive.name, figures(recorded_errors(drive), truth))))
    for name in options.receiver or ["phone"]:
        print("\n".join(rows(f"simulated {name}", simulated(name, truths[0], options.seeds))))


if __name__ == "__main__":
    main()
